# SPDX-License-Identifier: Apache-2.0
"""Expressions in words mean what oiiotool says they mean, and what it mumbles over is an error."""

from __future__ import annotations

import contextlib
import functools
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import OpenImageIO as oiio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oiiotex.engine.errors import ImageError, ParameterError
from oiiotex.engine.io.reading import read
from oiiotex.engine.session import Session
from oiiotex.oiiotool.cli.files.reading import read_input
from oiiotex.oiiotool.cli.language.expression_values import Value
from oiiotex.oiiotool.cli.language.expressions import substituted
from oiiotex.oiiotool.cli.language.sequences import Frame
from oiiotex.oiiotool.cli.stack.chain import Chain
from tests.peer import OIIOTOOL

FILES = ("constant.exr", "plain.tif", "ramp.exr")  # from the bottom of the stack up
VARIABLES: dict[str, Value] = {
    "i": 7, "v": 3.14159265, "big": 123456789, "f": 1e10, "neg": -5, "s": "hello", "Mixed": "Case", "e": "",
    "start": "12abc", "z": "007", "name": "plain.tif", "off": "off", "infinite": 1,
}  # fmt: skip
DECLARED = [f"--set{':type=string' if isinstance(v, str) else ''}" for v in VARIABLES.values()]


def chain_of(*files: str) -> Chain:
    """The images of FILES, the bottom one labeled L, at frame 7 of a sequence padded to four digits."""
    chain = Chain(Session(), read_input, Frame(7, (), 4) if files else None)
    chain.stack = [read(name) for name in files]
    chain.labeled = {"L": chain.stack[0]} if files else {}
    chain.user = dict(VARIABLES)
    return chain


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Pictures with windows and metadata, in what is then the current folder."""
    folder = tmp_path_factory.mktemp("expressions")
    with contextlib.chdir(folder):
        spec = oiio.ImageSpec(8, 6, 3, oiio.HALF)
        for name, value in {
            "ImageDescription": 'say "hello"\nand\tgo', "My:float": 12.5, "dash-y": 7, "precise": 3.14159265,
            "number": "0012", "MiXed": "case",
        }.items():  # fmt: skip
            spec.attribute(name, value)
        spec.attribute("array", "float[3]", (1.0, 2.5, 3.0))
        spec.attribute("rational", "rational", (3, 4))
        spec.attribute("smpte:TimeCode", "timecode", (0x01020304, 0))
        constant = oiio.ImageBuf(spec)
        oiio.ImageBufAlgo.fill(constant, (0.0, 1.0, 1.0))
        assert constant.write("constant.exr")
        plain = oiio.ImageBuf(oiio.ImageSpec(5, 4, 1, oiio.UINT8))
        plain.setpixel(2, 1, (1 / 3,))
        assert plain.write("plain.tif")
        spec = oiio.ImageSpec(20, 10, 4, oiio.FLOAT)
        spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height = 3, -4, 1, 2, 30, 20
        spec.tile_width = spec.tile_height = 16
        ramp = oiio.ImageBuf(spec)
        oiio.ImageBufAlgo.fill(ramp, (0.1, 0.0, 0.0, 1.0), (0.9, 1.0, 2.0, 1.0), roi=ramp.roi)
        ramp.setpixel(4, -3, (float("nan"), 0.0, float("inf"), 1.0))
        assert ramp.write("ramp.exr")
        yield folder


@pytest.fixture(scope="module")
def value_of(folder: Path) -> Callable[[str], str]:
    """What a text is with its expressions evaluated."""
    return functools.partial(substituted, chain=chain_of(*FILES))


SAME = r"""
{1/3} | {10/2} | {7//2} | {-7//2} | {7//-2} | {-7%3} | {7%-3} | {6%3} | {-6%3} | {7.9//2.9} | {5//0} | {5%0} | {1/0}
{-1/0}
{1234567} | {123456} | {0.00001} | {1e3} | {.5} | {1.} | {0x10} | {0x1.8p1} | {1e40} | {INF} | {-0} | {nan} | {007}
{1+2*3} | {(1+2)*3} | {2*3*4/8} | {8/4/2} | {5 - -3} | {1-2-3} | {(1/3)*3} | {1/3*3} | {16777216+1} | {0.1+0.2}
{1<2} | {2<1} | {2>1} | {1<=1} | {1>=2} | {1==1} | {1!=1} | {2<=>3} | {3<=>2} | {2<=>2} | {1+2==3} | {3==1+2} | {1<2<3}
{1&&0} | {1&1} | {0||2} | {0|0} | {1 && 2 || 0} | {!1} | {!0} | {!!5} | {-!5} | {+-+5} | {--5} | {- 5} | {!-0}
{ 1 + 2 }
{"abc"} | {'abc'} | {"3"+1} | {" 5 "} | {" 5 "*2} | {"a'b"} | {"a\"b"} | {'a"b'} | {""} | {"0x1p3"} | {-"abc"} | {"a b"}
{!"off"} | {!"On"} | {!" NO "} | {!"false"} | {!""} | {!s} | {!off} | {not("off")} | {not(1-1)} | {not(0.5)}
{not("0.0")}
{i} | {v} | {big} | {big+1} | {f} | {neg} | {s} | {Mixed} | [{e}] | {start} | {z} | {z+1} | {-i} | {-s} | {i*v} | {-i+1}
{var(i)} | {var("v")} | {var( 's')} | {var(mixed)} | {var("MIXED")} | [{var(nope)}] | {var(i)+1} | {2*var(i)}
{!not(var(i))}
{eq(1,1)} | {eq(1.0, 1)} | {eq("a","b")} | {eq(s,"hello")} | {eq(z,7)} | {eq(z,"007")} | {eq(v,"3.14159")}
{eq(f,"1e+10")}
{neq("a","b")} | {neq(1,1)} | {eq((1+1),2)} | {eq(big,"123456789")} | {!eq(1,2)} | {eq(eq(1,1),1)} | {-eq(1,1)}
{eq(-1,-1)}
{getattribute(version)} | {getattribute("version")} | {getattribute( 'format_list')} | {eq(getattribute(version),"x")}
{format("{:+}{:+}",3,-4)} | {format('{:5}|{:<5}|{:^5}|{:>5}|{:*^7}',1,2,3,4,5)}
{format('{:5}|{:>5}|{:.2}',s,'ab','abcd')}
{format('{:x}{:#x}{:X}{:#X}{:o}{:b}{:#b}{:#B}',255,255,255,255,8,5,5,5)} | {format('{:c}{:3c}|',65,66)}
{format('{:03}',7)}
{format('{:f} {:.2f} {:e} {:g} {:F} {:E}',1.5,2.5,1000.5,1.25,1.5,.5)} | {format('{:08.3f}',-3.14159)}
{format('{:08}',-1.5)}
{format('{}',1e6)} | {format('{}',1e17)} | {format('{}',0.1)} | {format('{}',1e-7)} | {format('{}',0-1e6)}
{format('{}',1/0)}
{format('{:.3}',2.5)} | {format('{:.3}',1e6)} | {format('{:.10}',0.1)} | {format('{:8}',1.5)}| {format('{: }',2)}
{format('{:08}',1/0)} | {format('{:6}|{:>6.1f}|{:06}|{:+6}|{:06}|',inf,inf,inf,inf,nan)}
{format('{0}{1}{0}','a','b')} | {format('{{{}}}',1)} | {format('{:{}}',1,5)}| {format('{:{}.{}f}|',1.5,9,3)}
{format('{2}',1,2,3)}
{format(s,1)} | {format('{} {}', i, 'x y')} | {format('{}',1+2*3)} | {format('{:<05}|',5)} | {format('{:s}','a')}
{format('{:L}',5)}
{(format('{:03}',7))} | {eq(format('{}',1),1)} | {format('{}',format('{:.3f}',2.5))} | {format("{}",s)}
{format('{}', "1_0")}
{TOP.width} | {TOP.height} | {TOP.width/2} | {TOP.x} | {TOP.y} | {-TOP.x} | {TOP.full_x} | {TOP.full_width}
{TOP.FULL_HEIGHT}
{TOP.nchannels} | {TOP.format} | {TOP.nativeformat} | {IMG[1].nativeformat} | {IMG[2].nativeformat} | {TOP.depth}
{TOP.z}
{TOP.geom} | {TOP.full_geom} | {TOP.datawindow} | {TOP.displaywindow} | {TOP.DataWindow} | {TOP.tile_width}
{TOP.alpha_channel}
{TOP.filename} | {TOP.file_extension} | {TOP.file_noextension} | {BOTTOM.filename} | {NIMAGES} | {TOP.SUBIMAGES}
{TOP.z_channel}
{IMG[0].filename} | {IMG[1].filename} | {IMG[2].filename} | {IMG[ 1 ].filename} | {IMG[NIMAGES-1].filename}
{IMG[-0].width}
{IMG[i-6].filename} | {IMG[L].filename} | {IMG[plain.tif].width} | {IMG["plain.tif"].width} | {IMG[name].filename}
{IMG[var(i)//4].width}
{IMG[2].ImageDescription} | {IMG[2]["My:float"]} | {IMG[2].'My:float'} | {IMG[2]."dash-y"} | {IMG[2].precise}
{IMG[2].mixed}
{IMG[2].number} | {eq(IMG[2].number,"0012")} | {IMG[2].array} | {IMG[2].rational} | {IMG[2]['smpte:TimeCode']} | {L[2]
[{TOP[nope]}] | [{TOP["no such"]}] | {TOP[width]} | {TOP['width']} | {TOP . width} | {TOP. width} | {TOP [width]}
{!TOP[nope]}
{TOP.MINCOLOR} | {TOP.MAXCOLOR} | {TOP.AVGCOLOR} | {IMG[1].MINCOLOR} | {IMG[1].MAXCOLOR} | {IMG[1].AVGCOLOR}
{TOP.NONFINITE_COUNT}
{IMG[2].IS_CONSTANT} | {TOP.IS_CONSTANT} | {IMG[2].IS_BLACK} | {IMG[1].IS_BLACK} | {IMG[1].NONFINITE_COUNT}
{IMG[1].MAXCOLOR*3}
{FRAME_NUMBER} | {FRAME_NUMBER_PAD} | {FRAME_NUMBER+1} | {(FRAME_NUMBER_PAD)+1} | {eq(FRAME_NUMBER_PAD,"0007")}
{ NIMAGES }
none | a{1}b{2}c | {1}{2} | x{1 | x{1}y{2 | } | }{1} | {format('{}-{}',1,2)}.{FRAME_NUMBER_PAD}.exr
{TOP.width}x{TOP.height}
""".strip().replace("\n", " | ").split(" | ")  # fmt: skip


@pytest.fixture(scope="module")
def theirs(folder: Path) -> list[str]:
    """What oiiotool prints for each of SAME, in one run."""
    if not OIIOTOOL.exists():
        pytest.skip("no oiiotool")
    declared = [w for option, (n, v) in zip(DECLARED, VARIABLES.items(), strict=True) for w in (option, n, str(v))]
    echoes = [w for text in SAME for w in ("--echo", "\x1e" + text.replace("\\", "\\\\"))]
    words = [FILES[0], "--label", "L", *FILES[1:], *declared, "--framepadding", "4", "--frames", "7-7", "--wildcardoff"]
    done = subprocess.run([OIIOTOOL, *words, *echoes], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:300]
    return [text.removesuffix("\n") for text in done.stdout.split("\x1e")[1:]]


def test_values_are_those_of_oiiotool(value_of, theirs):
    assert len(SAME) == len(theirs) >= 60
    ours = [value_of(text) for text in SAME]
    different = [f"{t}: {a!r}, oiiotool says {b!r}" for t, a, b in zip(SAME, ours, theirs, strict=True) if a != b]
    assert not different, "\n".join(different)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("{-(-5)}", "5"),  # oiiotool: --5
        ("{-neg}", "5"),
        ("{infinite}", "1"),  # oiiotool: inf
        ('{TOP[ "width" ]}', "20"),
        ("{- TOP.width}", "-20"),
    ],
)
def test_what_oiiotool_gets_wrong(value_of, text, value):
    assert value_of(text) == value


def test_outside_of_a_sequence_the_frame_is_0():
    assert substituted("{FRAME_NUMBER} {FRAME_NUMBER_PAD} {NIMAGES}", chain_of()) == "0 0 0"


REFUSED = {
    "{}": "expected a value at the end",
    "{ }": "expected a value at the end",
    "{1+}": "expected a value at the end",
    "{*2}": "expected a value before '\\*2'",
    "{1 2}": "unexpected '2' after the value",
    "{1,2}": "unexpected ',2' after the value",
    "{5x}": "unexpected 'x' after the value",
    '{"abc" def}': "unexpected 'def' after the value",
    '{"abc"*2}': "'abc': expected a number",
    "{TOP.filename + 1}": "'ramp.exr': expected a number",
    '{"abc}': "expected a value before '\"abc'",
    "{5--3}": "unknown operator '--'",
    "{1&&!0}": "unknown operator '&&!'",
    '{1*"abc"}': "'abc': expected a number",
    '{1+"abc"}': "'abc': expected a number",
    "{1+format('{}',1)}": ": expected a number",
    "{5//0.5}": "division by 0.5, which truncates to 0",
    "{1e10//1}": "1e\\+10: expected a 32-bit integer",
    "{nan%2}": "nan: expected a 32-bit integer",
    "{(1+2}": "expected '\\)'",
    "{" + "(" * 40 + "1" + ")" * 40 + "}": "expected at most 32 levels of nesting",
    "{" + "not(" * 40 + "1" + ")" * 40 + "}": "expected at most 32 levels of nesting",
    "{nosuch}": "unknown name 'nosuch'",
    "{NIMAGE}": "did you mean 'NIMAGES'",
    "{mixed}": "did you mean 'Mixed'",
    "{sqrt(2)}": "unknown function 'sqrt': expected one of getattribute, var, eq, neq, not, format",
    "{formt('{}',1)}": "did you mean 'format'",
    "{eq(1+1,2)}": "expected ',' of a comparison: put sums in parentheses",
    "{eq(1,1+1)}": "expected '\\)' of eq\\(\\)",
    "{not(s+1)}": "'hello': expected a number",
    "{not(1)1}": "unexpected '1' after the value",
    "{var()}": "expected a name between the parentheses",
    "{!var(i)}": "before var\\(\\)",
    "{getattribute(nope)}": "OpenImageIO has no attribute 'nope'",
    "{getattribute('version' x)}": "expected '\\)'",
    "{format('x')}": "expected ',' of format",
    "{format('{}{}',1)}": "requires more than 1 values",
    "{format('{x}',1)}": "field 'x': expected a number",
    "{format('{0.real}',1)}": "field '0.real': expected a number",
    "{format('{!r}',1)}": "unknown conversion '!r'",
    "{format('{0}{}',1,2)}": "cannot switch from manual",
    "{format('{:d}',1.5)}": "specification 'd' does not apply to 1.5",
    "{format('{:f}',1)}": "specification 'f' does not apply to 1",
    "{format('{:,}',1)}": "specification ',' does not apply to 1",
    "{format('{:.3}',1)}": "Precision not allowed",
    "{format('{:05}','ab')}": "requires a number",
    "{format('{:99999}',1)}": "does not apply to",
    "{TOP}": "expected .NAME or",
    "{TOP.}": "expected a name after '.'",
    "{TOP[]}": "expected a name after '\\['",
    "{TOP[width}": "expected '\\]' after 'width'",
    "{TOP.widht}": "ramp.exr has no 'widht', did you mean 'width'",
    "{TOP.MINCOLOUR}": "did you mean 'MINCOLOR'",
    "{IMG[2].My:float}": "names with ':' require quotes",
    "{IMG[3].x}": "no image at IMG\\[3\\]: the stack has 3",
    "{IMG[-1].x}": "no image at IMG\\[-1\\]",
    "{IMG[0.5].x}": "IMG\\[0.5\\]: expected a label, a file or an index",
    "{IMG[nosuch.exr].x}": "IMG\\[nosuch.exr\\]: expected a label, a file or an index",
    "{IMG['ramp.ex'].x}": "IMG\\[ramp.ex\\]: expected a label, a file or an index",
    "{IMG[].x}": "expected a label",
    "{IMG[.].x}": "a folder",
    "{IMG[0.x}": "expected '\\]' of IMG",
}


@pytest.mark.parametrize("text", REFUSED)
def test_malformed_expressions_are_refused_in_one_line_that_quotes_them(value_of, text):
    with pytest.raises((ParameterError, ImageError), match=REFUSED[text]) as caught:
        value_of(f"before {{1}} {text} behind")
    assert str(caught.value).startswith(" ".join(text.split()))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["{TOP.x}", "{BOTTOM.x}", "{IMG[0].x}"])
def test_an_empty_stack_has_no_image(text):
    with pytest.raises(ParameterError, match="no image at"):
        substituted(text, chain_of())


ODD = ("//", "<=", "&&", "{:", "getattribute(", "\\", "\0", "\n", "É", "²", "٣")
WORDS = [*re.findall(r"\w+|\W", "".join(SAME)), *ODD]
TEXTS = st.lists(st.one_of(st.sampled_from(WORDS), st.text(max_size=3)), max_size=12).map("".join)


@settings(max_examples=400, deadline=None, derandomize=True, database=None)
@given(text=st.one_of(TEXTS, TEXTS.map("{{{}}}".format), TEXTS.map('{{format("{{:{}}}",1,2.5,3)}}'.format)))
def test_any_text_is_substituted_or_refused(value_of, text):
    try:
        assert isinstance(value_of(text), str)
    except ParameterError as error:
        assert len(str(error).splitlines()) == 1
