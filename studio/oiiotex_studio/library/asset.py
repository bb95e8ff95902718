# SPDX-License-Identifier: Apache-2.0
"""Makes an asset from a material: runs its lines, delivers, measures and judges its files, in a new folder.

Workers do this, on this machine or a farm. A worker writes only to a folder of its run; the run moves it to its final
place.
"""

from __future__ import annotations

import contextlib
import datetime
import json
import shlex
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypedDict

from oiiotex import __version__
from oiiotex.engine.deferred import np, oiio
from oiiotex.engine.errors import Error, MemoryBudgetError, failure_of

from ..api.files import Allowed, digest_of, hash_of, owned, read_as, read_document, remove_folder
from ..api.images import TAG, Image, Progress, Session, read
from ..api.lines import LANGUAGE, parse
from ..api.materials import atlas_side
from ..materials import preview
from ..materials.documents import Described, write_materialx, write_usd
from ..materials.label_colors import label_colors
from ..materials.shaded import shaded_sphere
from ..recipes.found import MapFile, Material, Question, extract, link_or_copy, with_convention
from ..recipes.lines import SOURCE, ProductStep, source_name, steps_of
from ..recipes.recipe import LibraryRecipe
from .catalog import SIDECAR
from .digests import faults
from .hexes import LEAST, hex_measures, write_hexes
from .runs import WORK
from .steps import StepFile, run_line
from .wang import WangFiles, write_wang

SCHEMA = "oiiotex.asset/2"
_DELIVERY = 0.2  # of the time of a product's line: measures, documents and pictures
_SEED = 0  # arrangement of Wang tiles
_STEP = 0.1  # of a height map's range, between neighboring pixels


class _File(TypedDict):
    path: str
    bytes: int
    sha256: str


class _Sidecar(TypedDict):
    schema: Annotated[str, Allowed(among=[SCHEMA])]
    name: str
    key: str
    status: str
    reasons: list[str]
    files: list[_File]


class AssetJob(NamedTuple):
    """A job for a worker: one material."""

    material: Material
    recipe: LibraryRecipe
    photos: str  # absolute, as the library
    library: str
    work: str  # the folder to create, below the library
    before: str  # the asset's folder of an earlier run, whose unchanged products are reused; '' if none
    digests: tuple[tuple[str, str], ...]  # role and SHA-256 of each map's file or archive
    budget: int
    threads: int
    version: str = __version__


class Outcome(NamedTuple):
    """The result of a job."""

    name: str
    sidecar: dict[str, Any] | None  # Content of asset.json; None if the job failed or asks
    error: str = ""
    seconds: float = 0.0
    short_of_memory: bool = False  # Whether more memory would help
    asks: bool = False  # Whether `error` is a question


def key_of(material: Material, recipe: LibraryRecipe, digests: Mapping[str, str]) -> str:
    """The hash of everything that determines an asset."""
    known = material.facts
    return hash_of(
        SCHEMA, __version__, material.name, sorted(digests.items()), _maps(material),
        known.license, known.author, known.tags, known.size_m, known.height_m,
        recipe.products, recipe.deliver, [str(limit) for limit in recipe.limits], sorted(recipe.roles.items()),
    )[:16]  # fmt: skip


def make(job: AssetJob) -> Outcome:
    """Run a job. Errors are part of the result, so that other jobs continue."""
    start = time.perf_counter()
    if job.version != __version__:
        text = f"the worker has oiiotex {__version__}: expected {job.version}, as in the run; install the same version"
        return Outcome(job.material.name, None, text)
    folder, owner = Path(job.work), Path(job.library) / WORK
    try:
        remove_folder(folder, owner)
        folder.mkdir(parents=True)
        sidecar = _Making(job, folder).sidecar(start)
        return Outcome(job.material.name, sidecar, seconds=time.perf_counter() - start)
    except Exception as error:  # a bug must not end a run either
        with contextlib.suppress(Error):
            remove_folder(folder, owner)
        short, asks = isinstance(error, MemoryBudgetError), isinstance(error, Question)
        return Outcome(job.material.name, None, str(failure_of(error)), time.perf_counter() - start, short, asks)


def read_sidecar(folder: Path) -> dict[str, Any]:
    """Read and check the asset.json of a folder."""
    sidecar = read_document(owned(folder / SIDECAR, folder))
    read_as(_Sidecar, sidecar, str(folder / SIDECAR), Error, more=True)
    return dict(sidecar)


@dataclass
class _Making:
    """A running job."""

    job: AssetJob
    folder: Path
    maps: Mapping[str, MapFile] = field(default_factory=dict)  # with the convention of normals

    def __post_init__(self) -> None:
        self._step = StepFile(self.job.work)

    def sidecar(self, start: float) -> dict[str, Any]:
        """Make the asset, and return the content of its asset.json."""
        job, recipe = self.job, self.job.recipe
        material, told = with_convention(job.material, self._source)
        self.maps = material.maps
        steps = steps_of(recipe, material.maps)
        tile = next((step for step in steps if step.outputs), None)
        if tile is None:
            raise Error("the product with $outputs requires a map that this material does not have")
        stages = Progress(self._step.advance).stages(*[1.0] * len(steps), _DELIVERY)
        keys, reasons = self._products(steps, stages)
        delivery = next(stages)
        self._step.begin("measures and documents")
        maps = {role: read(self.folder / path) for role, path in tile.outputs.items()}
        measures, steps_px = self._measures(tile.product, maps)
        measures |= told
        labels = self._labels(steps, maps["color"])
        if labels:
            measures["labels"] = len(labels)
        meters = self._meters_a_pixel(tile, steps)
        hand, lattice = self._hand(), bool(steps_px)
        resources, shaded = _session(job).resources, None
        space = self._space(maps["color"])
        measures |= {} if lattice or recipe.deliver.wang else hex_measures(maps["color"], resources)
        hexes = measures.get("hex_fidelity", 0.0) >= LEAST
        described = Described(
            material.name, dict(tile.outputs), space, hand, relief=material.facts.height_m,
            hexes=write_hexes(maps, self.folder, space, resources) if recipe.deliver.hex and hexes else {},
        )  # fmt: skip
        wang, side = self._documents(described, self._textures(tile.outputs), meters), 1
        if wang is not None:
            side, measures["tiles"] = wang.side, wang.side**2
        delivery.advance(1, 2)
        self._step.begin("pictures")
        if recipe.deliver.shader:
            document, size_m = self.folder / f"{material.name}.mtlx", wang.size_m if wang else (1.0, 1.0)
            shaded = shaded_sphere(document, maps, resources, preview.LIT, size_m, side)
        looks = preview.Looks.of(maps, resources, hand, side, wang and wang.plane)
        for name, picture in looks.pictures(recipe.deliver.shape, hexes, self._photo(), shaded).items():
            preview.save(picture, self.folder / name)
        reasons += [
            f"{limit}: {measures[limit.measure]:.4g}"
            for limit in recipe.limits
            if limit.measure in measures and limit.passed_by(measures[limit.measure])
        ]
        if reasons:
            (self.folder / "reason.txt").write_text("\n".join(reasons) + "\n")
        remove_folder(self.folder / SOURCE, self.folder)
        facts, spec = material.facts, maps["color"].first.spec
        sidecar = {
            "schema": SCHEMA, "version": __version__, "name": material.name,
            "key": key_of(job.material, recipe, dict(job.digests)), "status": "review" if reasons else "ok",
            "reasons": reasons, "license": facts.license, "author": facts.author, "tags": list(facts.tags),
            "size_m": list(facts.size_m), "height_m": facts.height_m, "width": spec.width, "height": spec.height,
            "color_lab": [round(float(value), 3) for value in looks.mean_lab()], "lattice": steps_px,
            "tile_m": [meters[0] * spec.width / side, meters[1] * spec.height / side] if meters else [],
            "lattice_m": [[meters[0] * x, meters[1] * y] for x, y in steps_px] if meters else [],
            "labels": [{"name": name, "share": share, "color_lab": lab} for name, share, lab in labels],
            "normals": hand, "sources": self._sources(),
            "lines": {step.product: shlex.join(["oiiotex", *step.words]) for step in steps},
            "products": keys, "maps": dict(tile.outputs), "measures": measures, "files": self._files(),
            "wang": {"side": side, "index": wang.index_file, "tiles": wang.tiles, "seed": _SEED} if wang else {},
            "seconds": round(time.perf_counter() - start, 3),
            "made": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        }  # fmt: skip
        (self.folder / SIDECAR).write_text(json.dumps(sidecar, indent=1, ensure_ascii=False) + "\n")
        return sidecar

    # --- lines ---

    def _products(self, steps: Sequence[ProductStep], stages: Iterator[Progress]) -> tuple[dict[str, str], list[str]]:
        """Run the lines or reuse earlier files; returns the keys of reusable products, and failed limits."""
        keys: dict[str, str] = {}
        failed: dict[str, str] = {}
        before = self._before()
        for step, progress in zip(steps, stages, strict=False):
            keys[step.product] = hash_of(
                __version__, step.words, self.job.digests, _maps(self.job.material), [keys[t] for t in step.takes]
            )[:16]
            if before.get("products", {}).get(step.product) == keys[step.product] and self._taken(step, before):
                continue
            (self.folder / step.product).mkdir(exist_ok=True)
            self._lay_out_sources()
            self._step.begin(step.product)
            if status := run_line(step, self.folder, self.job.budget, self.job.threads, self._step.watch(progress)):
                failed[step.product] = f"product {step.product}: exceeds a limit of its line (exit code {status})"
        return {name: key for name, key in keys.items() if name not in failed}, list(failed.values())

    def _before(self) -> dict[str, Any]:
        """The asset.json of an earlier run; empty if there is none."""
        if self.job.before:
            with contextlib.suppress(Error):
                return read_sidecar(Path(self.job.before))
        return {}

    def _taken(self, step: ProductStep, before: Mapping[str, Any]) -> bool:
        """Reuse a product's files of an earlier run; False if they have changed."""
        old = Path(self.job.before)
        wang = before.get("wang") or {"index": "", "tiles": {}}
        added = {wang["index"], *wang["tiles"].values()}  # after the line
        files = [
            file
            for file in before["files"]
            if file["path"].startswith(f"{step.product}/") and file["path"] not in added
        ]
        if not files or faults(old, files):
            return False
        for file in files:
            target = self.folder / file["path"]
            target.parent.mkdir(parents=True, exist_ok=True)
            link_or_copy(old / file["path"], target)
        return True

    def _lay_out_sources(self) -> None:
        folder = self.folder / SOURCE
        if folder.exists():
            return
        folder.mkdir()
        for role, file in self.job.material.maps.items():
            extract(Path(self.job.photos), file, self.folder / source_name(role, file))

    def _source(self, role: str) -> Image:
        """A map of the photographer."""
        self._lay_out_sources()
        return read(self.folder / source_name(role, self.job.material.maps[role]))

    # --- delivery ---

    def _textures(self, outputs: Mapping[str, str]) -> dict[str, str]:
        """The maps that MaterialX reads: MIP-mapped textures if the recipe asks for them."""
        if not self.job.recipe.deliver.tx:
            return dict(outputs)
        (self.folder / "tx").mkdir()
        textures = {role: f"tx/{role}.tx" for role in outputs}
        for role, path in outputs.items():
            _write_texture(self.folder / path, self.folder / textures[role])
        return textures

    def _documents(self, described: Described, textures: dict[str, str], meters: tuple[float, ...]) -> WangFiles | None:
        """Write documents for renderers, those of Wang tiles if the recipe asks for them."""
        deliver = self.job.recipe.deliver
        if deliver.wang:
            spec = read(self.folder / described.maps["color"]).first.spec
            side = max(1, atlas_side(spec))
            size = [n * length / side for n, length in zip((spec.width, spec.height), meters, strict=False)]
            width, height = size or (1.0, spec.height / spec.width)  # of an unknown size: one unit wide
            maps, name, relief, hand = described.maps, described.name, described.relief, described.hand
            return write_wang(maps, self.folder, name, _SEED, (width, height), relief, hand, textures)
        if deliver.materialx:
            write_materialx(replace(described, maps=textures), self.folder)
        if deliver.usd:
            write_usd(described, self.folder)
        return None

    def _photo(self) -> np.ndarray:
        """The photo in the height of a card."""
        photo, file = self._source("color"), self.maps["color"]
        return preview.photo_linear(photo, self.job.recipe.space("color", file.floats), _session(self.job).resources)

    # --- description ---

    def _hand(self) -> str:
        """Convention of the delivered normals: 'opengl', 'directx' or ''."""
        normal = self.maps.get("normal")
        if normal is None:
            return ""
        return self.job.recipe.deliver.normals or normal.hand

    def _space(self, color: Image) -> str:
        return self.job.recipe.deliver.color or color.first.spec.get_string_attribute(TAG)

    def _measures(self, product: str, maps: Mapping[str, Image]) -> tuple[dict[str, float], list[list[float]]]:
        """Measures of the tile from its report and from normal and height maps; its lattice in pixels."""
        measures, lattice = dict[str, float](), list[list[float]]()
        report = self.folder / product / "report.json"
        if report.is_file():
            result = json.loads(report.read_text())["results"][0]
            measures, lattice = result["measures"], result.get("lattice", [])
        if "normal" in maps:
            grown = _beyond_unit(maps["normal"]) - _beyond_unit(self._source("normal"))
            measures["normal_length"] = max(0.0, grown)  # the scan's own lengths do not count
        if "height" in maps:
            measures["height_steps"] = _steps(preview.values(maps["height"])[..., 0])
        return measures, lattice

    def _labels(self, steps: Sequence[ProductStep], color: Image) -> list[tuple[str, float, list[float]]]:
        """Name, share and color of the labels of the first product with label maps."""
        for step in steps:
            for path in sorted((self.folder / step.product).glob("*.exr")):
                labels = label_colors(read(path), color, _session(self.job).resources)
                if labels:
                    return labels
        return []

    def _meters_a_pixel(self, tile: ProductStep, steps: Sequence[ProductStep]) -> tuple[float, ...]:
        """Meters per pixel of the tile along x and y; () if the photo's size is unknown or a line resizes."""
        size, needed = self.job.material.facts.size_m, {tile.product}
        for step in reversed(steps):
            if step.product in needed:
                needed |= set(step.takes)
        lines = [parse(list(step.words), LANGUAGE).steps for step in steps if step.product in needed]
        if not size or any(each.op is not None and each.op.rescales for line in lines for each in line):
            return ()
        photo = self._source("color").first.spec
        return size[0] / photo.width, size[1] / photo.height

    def _sources(self) -> list[dict[str, str]]:
        digests = dict(self.job.digests)
        return [
            {"role": role, "file": str(file), "sha256": digests[role]}
            | ({"channel": file.channel} if file.channel else {})
            | ({"normals": file.hand} if file.hand else {})
            for role, file in self.maps.items()
        ]

    def _files(self) -> list[dict[str, Any]]:
        """All written files, with their hashes."""
        files = []
        for path in sorted(path for path in self.folder.rglob("*") if path.is_file()):
            name = path.relative_to(self.folder).as_posix()
            files.append({"path": name, "role": role_of(name), "bytes": path.stat().st_size, "sha256": digest_of(path)})
        return files


def role_of(path: str) -> str:
    """The role of an asset's file in the catalog: its product, or its name or extension."""
    return path.split("/")[0] if "/" in path else Path(path).stem if path.endswith(".jpg") else Path(path).suffix[1:]


def _maps(material: Material) -> list[tuple[str, str, str, str]]:
    """Properties of a material's maps that affect the result, in addition to their content."""
    return [(role, file.suffix, file.channel, file.hand) for role, file in material.maps.items()]


def _beyond_unit(normals: Image) -> float:
    """Mean difference of the lengths of a map's normals from 1."""
    return float(np.abs(np.linalg.norm(preview.vectors(normals), axis=-1) - 1).mean())


def _steps(heights: np.ndarray) -> float:
    """Share of neighboring pixels, with wraparound, that differ by more than a tenth of the map's range."""
    most = _STEP * max(float(np.ptp(heights)), 1e-9)
    shares = [np.mean(np.abs(heights - np.roll(heights, 1, axis)) > most) for axis in (0, 1)]
    return float(np.mean(shares))


def _write_texture(source: Path, target: Path) -> None:
    """Write a MIP-mapped, periodic texture, upright: renderers ignore Orientation."""
    config = oiio.ImageSpec()
    config.tile_width = config.tile_height = 64
    config.tile_depth = 1
    config.attribute("wrapmodes", "periodic,periodic")
    upright = oiio.ImageBufAlgo.reorient(oiio.ImageBuf(str(source)))
    if not oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, upright, str(target), config):
        raise Error(f"{target}: {oiio.geterror()}")


_sessions: list[Session] = []  # one per process, because loading its color config is slow


def _session(job: AssetJob) -> Session:
    if not _sessions:
        _sessions.append(Session(threads=job.threads))
    return _sessions[0]
