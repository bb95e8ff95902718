# SPDX-License-Identifier: Apache-2.0
"""Kernels through clang for devices that are not here: NVIDIA's, AMD's and what reads SPIR.

A driver's compiler need not inline, may have no doubles, and puts private arrays into slow memory: no symbol may be
left that the target does not know, no double be computed with but in `DOUBLES`, no item hold more than is said here.
"""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.kernel_options import OPTIONS, compiled, require_known

FOLDER = Path(__file__).parents[2] / "oiiotex" / "cl"
# what is left before optimization is the front end's, and the same for all
LEVELS = {"nvptx64-nvidia-nvcl": ("-O2",), "amdgcn-amd-amdhsa": ("-O2",), "spir64": ("-O0", "-O2")}
TARGETS = (*LEVELS,)
# each once: clang is a link to one of them
CLANGS = [*{Path(found).resolve(): name for n in (*range(14, 41), 0)
            if (found := shutil.which(name := f"clang-{n}" if n else "clang"))}.values()]  # fmt: skip
missing = pytest.mark.skipif(not CLANGS, reason="NOTHING COMPILED FOR GPUs: no clang (apt install clang)")
# what OpenCL C itself has, by the names before mangling
BUILTINS = {
    "abs", "add_sat", "atomic_add", "atomic_dec", "atomic_inc", "barrier", "clz", "get_global_id", "get_group_id",
    "get_local_id", "get_num_groups", "max", "min", "rint", "sqrt", "vload8",
}  # fmt: skip
DOUBLES = ("slic_seeds",)  # built where there are doubles alone; test_squares.py has what others do instead
PRIVATE = 192  # bytes of an item's arrays at -O2
LARGER = {  # and of the kernels that have more
    "patchmatch_pick": lambda macros: 8 * macros["PATCH"] ** 2,  # a vote for each patch over the pixel
    "quilting_score": lambda macros: 1024,  # a histogram of labels in 512, and what clang 14 leaves in structures
    "quilting_best": lambda macros: 1024,
}


def compile_for(clang: str, target: str, level: str, source: Path, macros: dict[str, int]) -> str:
    """Intermediate code."""
    command = [clang, "-x", "cl", "-cl-std=CL1.2", "-target", target, level, "-w", "-S", "-emit-llvm", "-o", "-"]
    if target != "spir64":
        command.append("-nogpulib")  # the target's own library: its builtins stay declared
    defines = [f"-D{name}={value}" for name, value in {"LANES": 1, **macros}.items()]
    done = subprocess.run([*command, f"-I{FOLDER}", *defines, str(source)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, f"{clang} {target} {level} {source.name} {macros}:\n{done.stderr}"
    return done.stdout


def assembly_of(code: str, clang: str, target: str, level: str) -> str:
    """What the target's own code generator makes of intermediate code, which is optimized."""
    command = [clang, "-x", "ir", "-target", target, level, "-Xclang", "-disable-llvm-passes", "-S", "-o", "-", "-"]
    return subprocess.run(command, input=code, capture_output=True, text=True, timeout=300, check=True).stdout


def functions_of(code: str) -> dict[str, str]:
    """Bodies of LLVM's functions by name."""
    return {m[1]: m[2] for m in re.finditer(r"^define [^@]*@([\w.]+)\((.*?)^}", code, re.M | re.S)}


def undefined(code: str) -> set[str]:
    """Names that are declared and neither defined nor builtins, without mangling."""
    names = {m[1] for m in re.finditer(r"^declare [^@]*@([\w.]+)\(", code, re.M)}
    plain = {re.sub(r"^_Z(\d+)(.*)$", lambda m: m[2][: int(m[1])], name) for name in names}
    return {n for n in plain if not n.startswith(("llvm.", "convert_")) and n not in BUILTINS}


def private_bytes(code: str, name: str) -> int:
    """Of the arrays and structures that are left in memory, of a function and of what it calls."""
    bodies, kinds = functions_of(code), dict(re.findall(r"^(%[\w.]+) = type \{ (.*) \}", code, re.M))
    sizes = {"i8": 1, "i16": 2, "i32": 4, "i64": 8, "float": 4, "ptr": 8, "double": 8}

    def size(kind: str) -> int:
        if found := re.match(r"[\[<](\d+) x (.+)[\]>]$", kind):
            return int(found[1]) * size(found[2])
        if kind.endswith("*") or kind.startswith("ptr"):
            return 8
        return sum(map(size, kinds[kind].split(", "))) if kind in kinds else sizes[kind]

    def held(name: str) -> int:
        own = sum(size(found[1]) for found in re.finditer(r"= alloca (.+?), align", bodies[name]))
        called = {called for called in re.findall(r"call [^@\n]*@([\w.]+)\(", bodies[name]) if called in bodies}
        return own + max(map(held, called), default=0)

    return held(name)


def faults(clang: str, target: str, level: str, stem: str, macros: dict[str, int]) -> list[str]:
    """What a device of that kind would not take."""
    code = compile_for(clang, target, level, FOLDER / f"{stem}.cl", macros)
    found = [f"undefined {name}" for name in sorted(undefined(code))]
    if stem not in DOUBLES:
        found += [f"fp64: {line.strip()}" for line in re.findall(r"^.*\bdouble\b.*$", code, re.M)[:3]]
    kernels = [name for name in functions_of(code) if name.startswith(f"{stem}_")]
    assert kernels, code[:2000]
    if level != "-O0":
        for name in kernels:
            bound = LARGER[name](macros) if name in LARGER else PRIVATE
            if (size := private_bytes(code, name)) > bound:
                found.append(f"{name} holds {size} private bytes, {bound} are allowed")
    if target.startswith("nvptx") and level != "-O0":
        assembly = assembly_of(code, clang, target, level)
        if stem not in DOUBLES:
            found += [f"fp64: {line.strip()}" for line in re.findall(r"^.*\.f64\b.*$", assembly, re.M)[:3]]
        most = max(LARGER[name](macros) if name in LARGER else PRIVATE for name in kernels)
        for size in map(int, re.findall(r"__local_depot\d+\[(\d+)\];", assembly)):
            if size > most:
                found.append(f"a local depot of {size} bytes, {most} are allowed")
    return [f"{target} {level} {stem} {macros}: {fault}" for fault in found]


@missing
@pytest.mark.parametrize(("target", "level"), list(zip(TARGETS, ("-O2", "-O0", "-O0"), strict=True)))
def test_kernels_are_what_other_compilers_accept(target, level):
    found = [
        fault
        for stem in sorted(OPTIONS)
        for macros in compiled(stem)[:1]
        for fault in faults(CLANGS[0], target, level, stem, macros)
    ]
    assert not found, "\n".join(found)


@pytest.mark.slow
@missing
@pytest.mark.parametrize("clang", CLANGS)
@pytest.mark.parametrize("target", TARGETS)
def test_with_every_set_of_options_and_every_clang(clang, target):
    found = [
        fault
        for stem in sorted(OPTIONS)
        for macros in compiled(stem)
        for level in LEVELS[target]
        for fault in faults(clang, target, level, stem, macros)
    ]
    assert not found, "\n".join(found)


@missing
def test_what_no_compiler_would_take_is_found(tmp_path):
    source = tmp_path / "bad.cl"
    source.write_text(
        "inline int helper(int a) { return a * 3; }\n"
        "__kernel void bad_one(__global int *a, __global float *b, int n) {\n"
        "  int votes[99];\n"
        "  for (int k = 0; k < 99; k++) votes[a[k] % 99] = k;\n"
        "  a[get_global_id(0)] = helper(votes[n]); b[n] = (float)((double)b[0] * 1.1);\n"
        "}\n"
    )
    code = compile_for(CLANGS[0], TARGETS[0], "-O0", source, {})
    assert undefined(code) == {"helper"}
    assert "double" in code
    code = compile_for(CLANGS[0], TARGETS[0], "-O2", source, {})
    assert private_bytes(code, "bad_one") == 4 * 99


def test_the_table_has_all_that_the_source_builds():
    """Every `program("stem", MACRO=...)` in the package, and nothing else."""
    found: dict[str, set[str]] = {}
    for path in FOLDER.parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "program":
                (stem,), macros = (a.value for a in node.args), {k.arg for k in node.keywords}
                assert found.setdefault(stem, macros) == macros, path
    assert found == {stem: set(macros) for stem, macros in OPTIONS.items()}
    assert set(found) == {path.stem for path in FOLDER.glob("*.cl")}


def test_options_that_the_table_does_not_have_are_refused():
    require_known("patchmatch", {"PATCH": 11, "CHANNELS": 3, "LATTICE": 1, "PIECES": 0})
    wrong = {"PATCH": 11, "CHANNELS": 99, "LATTICE": 0, "PIECES": 0}
    for stem, macros in (("abacus", {}), ("quilting", {"RUN": 1}), ("patchmatch", wrong)):
        with pytest.raises(AssertionError, match=r"tests/kernel_options\.py"):
            require_known(stem, macros)
