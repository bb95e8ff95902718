# SPDX-License-Identifier: Apache-2.0
# Made by `python -m tools.docs.stubs` from the declarations: change those.
"""The filters as functions."""

from collections.abc import Sequence
from typing import Literal, overload

from OpenImageIO import ROI, ImageBuf

from ..core.op import Op
from ..deferred import Shelf
from ..python_types import FileName, ImageLike, Picture
from ..session import Session

SHELVES: tuple[Shelf, ...]
OURS: tuple[type[Op], ...]
FILTERS: tuple[type[Op], ...]

def further() -> tuple[type[Op], ...]: ...
def op_named(name: str) -> type[Op]: ...

@overload
def atlas(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    mesh: FileName | None = None,
    size: tuple[int, int] | None = None,
    udim: tuple[int, int] | None = None,
    scale: float | None = None,
    unwrapped: FileName | None = None,
    convention: Literal['opengl', 'directx'] = 'opengl',
    n: Literal[1] = 1,
    kinds: Sequence[str] | None = None,
    match: float | Sequence[float] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Make a texture for a 3-D object, that runs on over its surface where its charts end.

    Dominant texture on objects is figure 7 of LDR09 (Lu, Dorsey, Rushmeier, Dominant Texture and Diffusion Distance
    Manifolds, 2009): a mask of the dominant texture (`dominant`) keeps the photo's other things off the object. The
    pixels of the mesh's charts are synthesized from coarse to fine (Lefebvre & Hoppe, Appearance-space texture
    synthesis, SIGGRAPH 2006, section 5), each beside those that are its neighbors on the surface: through shared
    edges, turned and scaled. Directions follow the charts' u, evened out over the surface; texture has one size
    everywhere, whatever the charts' own. All maps of a material are made together (n=3:kinds=color,data,normal), and
    tangent-space normals turn with the texture. Gutters of 8 px show what lies beyond. A mesh without UVs gets charts
    by xatlas: unwrapped=FILE.obj is the mesh that goes with the result. Needs `pip install oiiotex[atlas]`.

    Parameters
    ----------
    exemplar : ImageLike
        the photo; of n maps of a material, the first
    mask : ImageLike | None, default None
        where pixels may come from: above one half of the first channel's range; of ids: all but 0; a text is the name of a part of the first image, else of a file
    labels : ImageLike | None, default None
        label maps of the exemplar, where they are not parts of it; a text is the name of a part of the first image, else of a file
    maps : Sequence[ImageLike], default ()
        the other maps of the material, made anew with it
    mesh : FileName | None, default None
        needed: OBJ, PLY, glTF, GLB, STL or OFF; its own UVs, in 0 to 1, without overlaps, else made ones
    size : tuple[int, int] | None, default None
        of the result, with udim of a tile; the exemplar's own when left out; (width, height) >= 16 and <= 16384 px
    udim : tuple[int, int] | None, default None
        columns x rows of UDIM tiles in which the mesh's UVs lie, from 1001 on; the result shows all of them, and -o:udim=3x2 "albedo.<UDIM>.exr" writes them apart; (width, height) >= 1 and <= 10
    scale : float | None, default None
        how wide the photo is on the surface, in the mesh's units; pixel for pixel when left out; a number >= 1e-09
    unwrapped : FileName | None, default None
        the mesh with the charts of the result goes to this file (.obj)
    convention : Literal['opengl', 'directx'], default 'opengl'
        where green of maps of kind normal points: up (opengl) or down
    n : int, default 1
        how many maps of one material are made together, the last images of the stack; a whole number >= 1 and <= 16
    kinds : Sequence[str] | None, default None
        what the maps are, in their order: color (or color), data, normal or height; when left out the first is as without further maps, the others are data. What is no color is tagged as data
    match : float | Sequence[float] | None, default None
        how much the maps count when patches are compared, in their order; 0: not at all; when left out 1 for every map, 0.25 for a height; a number or a sequence of them >= 0
    label : int | None, default None
        take only pixels of that label, by its id; a whole number >= 1
    level : int | None, default None
        which label map: label.N of the exemplar or of labels; the coarsest when left out; a whole number >= 1
    data : bool, default False
        the channels are no colors: compare them as they are
    seed : int, default 0
        same seed, same pixels; a whole number >= 0 and <= 4294967295
    stmap : bool | FileName, default False
        1: source coordinates as part 'st' of the result; a file name: there
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]
        a dict where more than one part was asked for
        a list of these where there are several images
        atlas: pixels copied from the photo, all channels together, in its own color space and type; of n maps n images, in their order; normals are turned [pixels]
        st: where every pixel comes from, as `warp` and `st_warp` read it [32-bit float coordinates; with stmap]
        mesh: the mesh with the charts that the result is for [.obj; with unwrapped]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def atlas(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    mesh: FileName | None = None,
    size: tuple[int, int] | None = None,
    udim: tuple[int, int] | None = None,
    scale: float | None = None,
    unwrapped: FileName | None = None,
    convention: Literal['opengl', 'directx'] = 'opengl',
    n: Literal[1] = 1,
    kinds: Sequence[str] | None = None,
    match: float | Sequence[float] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def atlas(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    maps: Sequence[ImageLike] = (),
    mesh: FileName | None = None,
    size: tuple[int, int] | None = None,
    udim: tuple[int, int] | None = None,
    scale: float | None = None,
    unwrapped: FileName | None = None,
    convention: Literal['opengl', 'directx'] = 'opengl',
    n: int = 1,
    kinds: Sequence[str] | None = None,
    match: float | Sequence[float] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]: ...

@overload
def checkmaterial(
    source: ImageLike,
    /,
    *,
    n: Literal[1] = 1,
    kinds: Sequence[str] | None = None,
    convention: Literal['opengl', 'directx'] = 'opengl',
    fail: Literal['errors', 'warnings', 'none'] = 'errors',
    json: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Find what a renderer will not like about the maps of a material; the maps go on as they are.

    Of all maps: sizes that differ, NaN and Inf, a color space that is wrong for what they hold. Of albedo: values that
    no surface has, and baked light: slow drift of lightness, lightness that follows the normals (light from one side)
    or the heights (occlusion). Of normals: vectors that are not of length 1 or point down, a mean that leans, and green
    that points the wrong way (OpenGL up, DirectX down), by the heights where there are any, else because slopes of a
    surface have no curl. Of heights: none at all, and 8 bits. Of other data: values outside of 0 to 1.
    Each finding is printed on a line, and json= keeps them with all measures. An error renders wrong, a warning may;
    with fail=errors, as it is, the run goes to its end and its exit code is 3 where there is an error.

    Parameters
    ----------
    source : ImageLike
        the map; of n maps of a material, the first
    maps : Sequence[ImageLike], default ()
        the other maps of the material
    n : int, default 1
        how many maps are looked at together, the last images of the stack; a whole number >= 1 and <= 16
    kinds : Sequence[str] | None, default None
        what the maps are, in their order: color (or color), data, normal or height; when left out the first is as without further maps, the others are data. What is no color is tagged as data
    convention : Literal['opengl', 'directx'], default 'opengl'
        green of normals shall point up or down
    fail : Literal['errors', 'warnings', 'none'], default 'errors'
        what makes the exit code 3
    json : FileName | None, default None
        findings and measures go to this file
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | list[ImageBuf] | list[dict[str, ImageBuf]]
        a dict where more than one part was asked for
        a list of these where there are several images
        map: the maps as they came [pixels]
        report: findings, and measures of every map [JSON; with json]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def checkmaterial(
    source: ImageLike,
    /,
    *,
    maps: Sequence[ImageLike] = (),
    n: int = 1,
    kinds: Sequence[str] | None = None,
    convention: Literal['opengl', 'directx'] = 'opengl',
    fail: Literal['errors', 'warnings', 'none'] = 'errors',
    json: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | list[ImageBuf] | list[dict[str, ImageBuf]]: ...

@overload
def composite(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tries: int = 4,
    plan: FileName | None = None,
    grown: Literal[False] = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    reuse: float = 1.0,
    finer: float = 0.5,
    guidance: float = 1.0,
    keep: Literal[False] = False,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Grow what a photo consists of to any size, and fill it with the photo's texture.

    Grows a new label map from the one that `label` has found, with its shares and neighborhoods, and quilts it
    (`quilt` with the grown map as its guide): the automatic synthesis of non-stationary textures that LSA16
    (Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis,
    SIGGRAPH 2016) leaves for the future in section 7. Every pixel of the result is a copy of one pixel of the photo.

    Parameters
    ----------
    exemplar : ImageLike
        the photo; where labels are spoken of, with label maps as `label` with `keep` makes them
    mask : ImageLike | None, default None
        where pixels may come from: above one half of the first channel's range; of ids: all but 0; a text is the name of a part of the first image, else of a file
    labels : ImageLike | None, default None
        label maps of the exemplar, where they are not parts of it; a text is the name of a part of the first image, else of a file
    size : tuple[int, int] | None, default None
        of the result; twice the exemplar's when left out; (width, height) >= 8 and <= 4194304 px
    tries : int, default 4
        label maps that are grown; the nearest to the found one is taken; a whole number >= 1 and <= 64
    plan : FileName | None, default None
        the plan goes to this file (.npz): `quilt` with `render` renders it
    grown : bool, default False
        the grown label map follows as part 'grown'
    report : FileName | None, default None
        measures of the result go to this file, JSON (docs/reference/report.md)
    fail : Sequence[str] | None, default None
        limits of measures, NAME>NUMBER or NAME<NUMBER, such as seam>1.3 and repeat>4: beyond one the run exits 3
    tile : Literal['none', 'x', 'y', 'xy'], default 'none'
        along which axes the result tiles
    patch : int | None, default None
        side of a patch; the label level's scale, or shorter side / 8, as a power of two when left out (less where a guide's labels are found in too few places); a whole number >= 8 and <= 256 px
    candidates : int, default 256
        patches that are tried in a place, at most; a whole number >= 1 and <= 65536
    reuse : float, default 1.0
        a region of the exemplar that is shown oftener than twice, and than once more than this times its fair share, costs, the more the oftener; a number >= 0 and <= 1000000000
    finer : float, default 0.5
        weight of finer levels' labels in the overlaps, beside color; a number >= 0 and <= 100
    guidance : float, default 1.0
        weight of the guide's labels inside a patch, beside color; a number >= 0 and <= 100
    keep : bool, default False
        label parts of the exemplar follow, made from the same sources
    level : int | None, default None
        which label map: label.N of the exemplar or of labels; the coarsest when left out; a whole number >= 1
    data : bool, default False
        the channels are no colors: compare them as they are
    seed : int, default 0
        same seed, same pixels; a whole number >= 0 and <= 4294967295
    stmap : bool | FileName, default False
        1: source coordinates as part 'st' of the result; a file name: there
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        composite: pixels copied from the photo, all channels together, in its own color space and type [pixels]
        st: where every pixel comes from, as `warp` and `st_warp` read it [32-bit float coordinates; with stmap]
        label.N: label parts of the photo, made from the same sources [32-bit ids; with keep]
        plan: offsets and cuts [.npz; with plan]
        grown: the label map that was grown: a guide for `quilt` and `paint` [32-bit ids; with grown]
        report: measures of the result, for machines [JSON; with report]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def composite(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tries: int = 4,
    plan: FileName | None = None,
    grown: Literal[True],
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    reuse: float = 1.0,
    finer: float = 0.5,
    guidance: float = 1.0,
    keep: bool = False,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def composite(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tries: int = 4,
    plan: FileName | None = None,
    grown: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    reuse: float = 1.0,
    finer: float = 0.5,
    guidance: float = 1.0,
    keep: bool = False,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def composite(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tries: int = 4,
    plan: FileName | None = None,
    grown: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    reuse: float = 1.0,
    finer: float = 0.5,
    guidance: float = 1.0,
    keep: bool = False,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

def content(
    source: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    at: float | Sequence[float] | None = None,
    level: int | None = None,
    patch: int | None = None,
    table: bool = False,
    json: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Show where an image has the same content as at a place, or draw the table of all contents.

    The content of a square patch is its key: the two most frequent labels in it at a level (LSA16: Lockerman, Sauvage,
    Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016,
    section 6.1). The centers of all patches with the key of the patch around `at` are marked red on the photo, and
    that patch is outlined (figure 10). The histograms of that patch at every level are printed (figure 9); json keeps
    them. With `table` every key is shown by a patch that has it, first label down, second across (figure 11).
    The result is an 8-bit sRGB image for screens: do not measure it.

    Parameters
    ----------
    source : ImageLike
        an image with label parts, as `label` with `keep` makes it
    labels : ImageLike | None, default None
        label maps of the exemplar, where they are not parts of it; a text is the name of a part of the first image, else of a file
    at : float | Sequence[float] | None, default None
        x,y in the data window: the patch's middle; that of the image's; a number or a sequence of them px
    level : int | None, default None
        which label map; the coarsest when left out; a whole number >= 1
    patch : int | None, default None
        side; the level's scale as a power of two; a whole number >= 4 and <= 256 px
    table : bool, default False
        draw the table of keys instead
    json : FileName | None, default None
        key, histograms of every level and the sizes of all keys go to this file
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        view: the photo with what is alike, or the table of keys [8-bit sRGB picture]
        facts: key, histograms of every level, sizes of all keys [JSON; with json]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

@overload
def cut(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tile: Literal['xy', 'x', 'y', 'none'] = 'xy',
    patch: int | None = None,
    passes: int = 1,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: FileName | Literal[False] = False,
    structure: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Lay a texture from large pieces of a photo, cut where it is seen least.

    Graph-cut textures (KSE03: Kwatra, Schoedl, Essa, Turk, Bobick, Graphcut Textures, SIGGRAPH 2003): patches that fit
    are laid one after another, and each is cut against all that is there along the cheapest line of any shape; where
    an old seam is expensive, a new patch covers it. Of a photo with labels it takes one alone (LSA16: Lockerman,
    Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH
    2016, section 5.2): label=3, or a mask. Every pixel of the result is a copy of one pixel of the photo.

    Parameters
    ----------
    exemplar : ImageLike
        the photo; where labels are spoken of, with label maps as `label` with `keep` makes them
    mask : ImageLike | None, default None
        where pixels may come from: above one half of the first channel's range; of ids: all but 0; a text is the name of a part of the first image, else of a file
    labels : ImageLike | None, default None
        label maps of the exemplar, where they are not parts of it; a text is the name of a part of the first image, else of a file
    size : tuple[int, int] | None, default None
        of the result; the exemplar's own when left out; (width, height) >= 5 and <= 16384 px
    tile : Literal['xy', 'x', 'y', 'none'], default 'xy'
        along which axes the result tiles
    patch : int | None, default None
        side of a patch; shorter side of the exemplar / 5, 16 to 96, when left out; a whole number >= 5 and <= 512 px
    passes : int, default 1
        of refinement: patches over the worst seams, as many as were laid; a whole number >= 0 and <= 100
    report : FileName | None, default None
        measures of the result go to this file, JSON (docs/reference/report.md)
    fail : Sequence[str] | None, default None
        limits of measures, NAME>NUMBER or NAME<NUMBER, such as seam>1.3 and repeat>4: beyond one the run exits 3
    label : int | None, default None
        take only pixels of that label, by its id; a whole number >= 1
    level : int | None, default None
        which label map: label.N of the exemplar or of labels; the coarsest when left out; a whole number >= 1
    data : bool, default False
        the channels are no colors: compare them as they are
    seed : int, default 0
        same seed, same pixels; a whole number >= 0 and <= 4294967295
    stmap : bool | FileName, default False
        1: source coordinates as part 'st' of the result; a file name: there
    structure : float, default 0.5
        strength with which regular repeats of the photo (tiles, courses, weaves) are kept; 0: not at all. Where the photo's size would stretch them visibly, the default size is the nearest that holds complete repeats only. No effect on a photo without regular repeats; a number >= 0 and <= 1
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        cut: pixels copied from the photo, all channels together, in its own color space and type [pixels]
        st: where every pixel comes from, as `warp` and `st_warp` read it [32-bit float coordinates; with stmap]
        report: measures of the result, for machines [JSON; with report]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def cut(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tile: Literal['xy', 'x', 'y', 'none'] = 'xy',
    patch: int | None = None,
    passes: int = 1,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: Literal[True],
    structure: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def cut(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tile: Literal['xy', 'x', 'y', 'none'] = 'xy',
    patch: int | None = None,
    passes: int = 1,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    structure: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

@overload
def decompose(
    source: Picture,
    /,
    *,
    labels: int | None = None,
    group: Literal['merging', 'cliques'] | None = None,
    threshold: float | None = None,
    radius: float | None = None,
    shift: float | None = None,
    features: Literal['bank', 'haar'] = 'bank',
    bins: int | None = None,
    step: int | None = None,
    scales: int = 1,
    search: Literal['grid', 'meanshift'] = 'grid',
    refine: bool = True,
    assign: Literal['competition', 'neighbors'] = 'competition',
    paper: bool = False,
    keep: Literal[False] = False,
    cryptomatte: Literal[False] = False,
    names: FileName | None = None,
    single: Literal[False] = False,
    json: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Decompose a texture into the simpler ones that it is a patchwork of.

    Regions compete for pixels by their textons; those that are likelier one texture than two are merged, until none
    are, or as many are left as labels asks for; then the subtextures compete once more. The result is a label map: ids
    from 1 on, 0 where alpha is 0. Images above a megapixel are looked at reduced by a whole factor. group=cliques
    compares places by their texton histograms instead, each with the best match near the other, and groups them by a
    clique partition; `paper` is that way by the letter (CZF02: Caenen, Zalesny, Ferrari, Van Gool, Unsupervised
    Texture Segmentation by Clique Partitioning).

    Parameters
    ----------
    source : ImageLike
        the image
    labels : int | None, default None
        how many subtextures, at most; found when left out; a whole number >= 1 and <= 50
    group : Literal['merging', 'cliques'] | None, default None
        of regions, or of places that are compared; with haar: cliques
    threshold : float | None, default None
        probability of two regions to be one texture, or similarity of two places, above which they belong together; more gives more subtextures; a number >= 0 and <= 1
    radius : float | None, default None
        of the disc whose textons describe a place; a quarter of it is what a pixel minds; a number >= 1 and <= 512 px
    shift : float | None, default None
        cliques: how far from a place its best match may be; 0: plain comparison; a number >= 0 and <= 512 px
    features : Literal['bank', 'haar'], default 'bank'
        what textons are made of; haar: the paper's
    bins : int | None, default None
        textons; with haar so many of color and so many of detail; a whole number >= 2 and <= 64
    step : int | None, default None
        cliques: between the places that are compared with all others; a whole number >= 1 and <= 512 px
    scales : int, default 1
        cliques: radii of the second place, half an octave apart; a whole number >= 1 and <= 5
    search : Literal['grid', 'meanshift'], default 'grid'
        cliques: for the best match; meanshift: the paper's, slow
    refine : bool, default True
        of the cliques, by moves of single places; the paper does not
    assign : Literal['competition', 'neighbors'], default 'competition'
        of pixels to subtextures; neighbors: the paper's
    paper : bool, default False
        CZF02 by the letter: features=haar:group=cliques:scales=3:search=meanshift:refine off:assign=neighbors
    keep : bool, default False
        the photo stays the first part, the labels follow it
    cryptomatte : bool | FileName, default False
        1: a further part with Cryptomatte 1.2; a file name: its manifest goes there
    names : FileName | None, default None
        table of `palette`: what labels are called, in parts and in Cryptomatte
    single : bool, default False
        with cryptomatte: one nameless part of the image's channels and Cryptomatte's, as Blender and Nuke take it at once
    json : FileName | None, default None
        count, areas and settings go to this file
    data : bool, default False
        the channels are no colors: compare them as they are
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        photo: the photo, before all others [pixels; with keep]
        label.1: one channel, of the image's windows: write it to EXR or TIFF [32-bit ids]
        cryptomatte: the labels [Cryptomatte 1.2; with cryptomatte]
        facts: count, areas and settings [JSON; with json]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def decompose(
    source: ImageLike,
    /,
    *,
    labels: int | None = None,
    group: Literal['merging', 'cliques'] | None = None,
    threshold: float | None = None,
    radius: float | None = None,
    shift: float | None = None,
    features: Literal['bank', 'haar'] = 'bank',
    bins: int | None = None,
    step: int | None = None,
    scales: int = 1,
    search: Literal['grid', 'meanshift'] = 'grid',
    refine: bool = True,
    assign: Literal['competition', 'neighbors'] = 'competition',
    paper: bool = False,
    keep: Literal[True],
    cryptomatte: bool | FileName = False,
    names: FileName | None = None,
    single: Literal[False] = False,
    json: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def decompose(
    source: ImageLike,
    /,
    *,
    labels: int | None = None,
    group: Literal['merging', 'cliques'] | None = None,
    threshold: float | None = None,
    radius: float | None = None,
    shift: float | None = None,
    features: Literal['bank', 'haar'] = 'bank',
    bins: int | None = None,
    step: int | None = None,
    scales: int = 1,
    search: Literal['grid', 'meanshift'] = 'grid',
    refine: bool = True,
    assign: Literal['competition', 'neighbors'] = 'competition',
    paper: bool = False,
    keep: bool = False,
    cryptomatte: Literal[True],
    names: FileName | None = None,
    single: Literal[False] = False,
    json: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def decompose(
    source: ImageLike,
    /,
    *,
    labels: int | None = None,
    group: Literal['merging', 'cliques'] | None = None,
    threshold: float | None = None,
    radius: float | None = None,
    shift: float | None = None,
    features: Literal['bank', 'haar'] = 'bank',
    bins: int | None = None,
    step: int | None = None,
    scales: int = 1,
    search: Literal['grid', 'meanshift'] = 'grid',
    refine: bool = True,
    assign: Literal['competition', 'neighbors'] = 'competition',
    paper: bool = False,
    keep: bool = False,
    cryptomatte: bool | FileName = False,
    names: FileName | None = None,
    single: bool = False,
    json: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

@overload
def dominant(
    source: Picture,
    /,
    *,
    mask: ImageLike | None = None,
    patch: int | None = None,
    step: int | None = None,
    rule: Literal['repaired', 'paper'] = 'repaired',
    mode: Literal['diffusion', 'euclidean', 'spectral'] = 'diffusion',
    paper: bool = False,
    strict: bool = False,
    keep: Literal[False] = False,
    types: Literal[False] = False,
    score: Literal[False] = False,
    json: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Find the dominant texture of a photo: a mask without objects, cracks, stains and shadows.

    Overlapping patches are points in a space of colors; heat that spreads from the densest one reaches the large
    group of patches that look alike, and hardly those that do not (LDR09: Lu, Dorsey, Rushmeier, Dominant Texture and
    Diffusion Distance Manifolds, Eurographics 2009). The mask is 1 where dominant patches lie, else 0. A photo of
    which no group of patches holds 40 % is rejected: a warning and an empty mask, or an error with `strict`. With
    `keep` the photo stays the first part and the mask follows it as part 'dominant', ready to guide a synthesis.
    Attributes say the patch's side in px (oiiotex:patch), the kernel's size (oiiotex:epsilon), the manifold's
    dimension (oiiotex:dimension), the steps of the diffusion (oiiotex:tau) and the share of dominant patches
    (oiiotex:share).

    Parameters
    ----------
    source : ImageLike
        the photo
    mask : ImageLike | None, default None
        where to look: what it leaves out is no part of the photo; a text is the name of a part of the first image, else of a file
    patch : int | None, default None
        side of a patch, made odd; from the Fourier transform when left out; a whole number >= 3 and <= 63 px
    step : int | None, default None
        between patches; the smallest that leaves 12000 of them when left out; a whole number >= 1 and <= 256 px
    rule : Literal['repaired', 'paper'], default 'repaired'
        thresholds, mask; paper: as its text has them
    mode : Literal['diffusion', 'euclidean', 'spectral'], default 'diffusion'
        euclidean: the paper's eq. 7; spectral: the larger half of a normalized cut
    paper : bool, default False
        LDR09 by the letter: rule=paper:mode=diffusion:step=1, and noise is not looked for
    strict : bool, default False
        a photo without a dominant texture is an error
    keep : bool, default False
        the photo stays the first part, the mask follows it
    types : bool, default False
        a further part: 1 to 4 for patches of type 0 to III around a pixel, 0 where none
    score : bool, default False
        a further part: density, and the decimal logarithm of heat
    json : FileName | None, default None
        the kernel's curve, thresholds, rounds and shares go to this file
    chart : FileName | None, default None
        a picture of the kernel's curve, and of density over heat with their thresholds, goes to this file
    data : bool, default False
        the channels are no colors: compare them as they are
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        photo: the photo, before all others [pixels; with keep]
        dominant: 1 where the dominant texture is; in the image's windows [0 or 1, 32-bit floats]
        types: 1 to 4 for patches of type 0 to III around a pixel, 0 where none [32-bit ids; with types]
        score: density, and the decimal logarithm of heat [32-bit float values; with score]
        facts: the kernel's curve, thresholds, rounds and shares [JSON; with json]
        chart: the kernel's curve, and density over heat [8-bit sRGB picture; with chart]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def dominant(
    source: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    patch: int | None = None,
    step: int | None = None,
    rule: Literal['repaired', 'paper'] = 'repaired',
    mode: Literal['diffusion', 'euclidean', 'spectral'] = 'diffusion',
    paper: bool = False,
    strict: bool = False,
    keep: Literal[True],
    types: bool = False,
    score: bool = False,
    json: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def dominant(
    source: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    patch: int | None = None,
    step: int | None = None,
    rule: Literal['repaired', 'paper'] = 'repaired',
    mode: Literal['diffusion', 'euclidean', 'spectral'] = 'diffusion',
    paper: bool = False,
    strict: bool = False,
    keep: bool = False,
    types: Literal[True],
    score: bool = False,
    json: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def dominant(
    source: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    patch: int | None = None,
    step: int | None = None,
    rule: Literal['repaired', 'paper'] = 'repaired',
    mode: Literal['diffusion', 'euclidean', 'spectral'] = 'diffusion',
    paper: bool = False,
    strict: bool = False,
    keep: bool = False,
    types: bool = False,
    score: Literal[True],
    json: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def dominant(
    source: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    patch: int | None = None,
    step: int | None = None,
    rule: Literal['repaired', 'paper'] = 'repaired',
    mode: Literal['diffusion', 'euclidean', 'spectral'] = 'diffusion',
    paper: bool = False,
    strict: bool = False,
    keep: bool = False,
    types: bool = False,
    score: bool = False,
    json: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

def estimateao(
    source: ImageLike,
    /,
    *,
    radius: int = 32,
    scale: float | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Work out how much of an even sky every place of a height map sees.

    1 is a place that nothing stands around. Of sixteen directions the steepest horizon within the radius is taken, and
    the light between horizons in closed form (Jimenez and others 2016, eq. 10). It is right for the heights that it is
    given, to 0.01 of what rays say; what is guessed is how high they are, where neither scale= nor the attribute
    oiiotex:heightpx says it, and that what is farther away than the radius hides nothing.

    Parameters
    ----------
    source : ImageLike
        heights, the first channel; larger is nearer
    radius : int, default 32
        how far away something may stand and hide the sky; a whole number >= 2 and <= 1024 px
    scale : float | None, default None
        how high 1 is; as the attribute oiiotex:heightpx says when left out, else longer side / 32; a number >= 1e-06 and <= 1000000 px
    tile : Literal['none', 'x', 'y', 'xy'], default 'none'
        along which axes the heights tile
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        ao: one channel, 0 (nothing reaches it) to 1 (all of the sky does) [32-bit float values]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

@overload
def estimateheight(
    source: ImageLike,
    /,
    *,
    normal: FileName | Literal[False] = False,
    light: float | None = None,
    overcast: bool = False,
    elevation: float = 45.0,
    sigma: float | None = None,
    strength: float = 1.0,
    convention: Literal['opengl', 'directx'] = 'opengl',
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Guess heights, and normals, from how one photo is shaded.

    The surface is taken for matt, of one color but for what is larger than sigma, and lit from one side (Pentland
    1990) or by an overcast sky, under which what is deep is dark (Langer and Zucker 1994); heights are the integrable
    surface nearest to the slopes that this says (Frankot and Chellappa 1988, by FFT). Paint is taken for relief: where
    a scan has heights, use these. From which end of its direction light comes no photo of relief says: above is
    assumed, left of two sides; light= says it, and turns what is raised into what is sunken where it was wrong.
    Heights go from 0 to 1; the attribute oiiotex:heightpx says how many pixels that is.

    Parameters
    ----------
    source : ImageLike
        the photo
    normal : bool | FileName, default False
        1: normals as part 'normal' of the result; a file name: there
    light : float | None, default None
        where light comes from, counterclockwise from the right: 90 is from above; when left out as the shading says, overcast where no direction stands out; a number >= -360 and <= 360 degrees
    overcast : bool, default False
        light has no direction: dark is deep
    elevation : float, default 45.0
        of the light above the surface: low light shades small relief as much; a number >= 1 and <= 89 degrees
    sigma : float | None, default None
        what is larger is color or uneven light and no relief; longer side / 8 when left out; a number >= 1 and <= 1000000 px
    strength : float, default 1.0
        by how much slopes of the normals are steeper; a number >= 0.01 and <= 100
    convention : Literal['opengl', 'directx'], default 'opengl'
        where green of the normals points: up (opengl) or down
    tile : Literal['none', 'x', 'y', 'xy'], default 'none'
        along which axes the photo tiles
    data : bool, default False
        the channels are no colors: the first is luminance
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        height: one channel, 0 to 1, larger is nearer [32-bit float values]
        normal: normals of these heights, as colors from 0 to 1 [32-bit float values; with normal]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def estimateheight(
    source: ImageLike,
    /,
    *,
    normal: Literal[True],
    light: float | None = None,
    overcast: bool = False,
    elevation: float = 45.0,
    sigma: float | None = None,
    strength: float = 1.0,
    convention: Literal['opengl', 'directx'] = 'opengl',
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def estimateheight(
    source: ImageLike,
    /,
    *,
    normal: bool | FileName = False,
    light: float | None = None,
    overcast: bool = False,
    elevation: float = 45.0,
    sigma: float | None = None,
    strength: float = 1.0,
    convention: Literal['opengl', 'directx'] = 'opengl',
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

def estimateroughness(
    source: ImageLike,
    /,
    *,
    sigma: float | None = None,
    middle: float = 0.6,
    amount: float = 0.3,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Guess how rough a surface is from its photo's local contrast.

    Where a bumpy surface is smooth it glitters: highlights lie beside dark reflections. What is looked at is the
    contrast of the finest detail, in linear light, over a Gaussian of sigma. Roughness is `middle` where that is as in
    the whole photo, and at most `amount` more or less. It is a weak guess (its page has figures):
    fine paint looks smooth to it, and a photo under an overcast sky says next to nothing. Where a scan has roughness,
    use that. It needs no more memory for a large photo than for a small one.

    Parameters
    ----------
    source : ImageLike
        the photo
    sigma : float | None, default None
        scale of the contrast; longer side / 16, 2 at least, when left out; a number >= 1 and <= 1000000 px
    middle : float, default 0.6
        roughness where contrast is as everywhere; a number >= 0 and <= 1
    amount : float, default 0.3
        by how much it is more or less at most; a number >= 0 and <= 1
    data : bool, default False
        the channels are no colors: the first is lightness
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        roughness: one channel, 0 (a mirror) to 1 (matt) [32-bit float values]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

@overload
def flatten(
    source: Picture,
    /,
    *,
    mask: ImageLike | None = None,
    radius: float | None = None,
    amount: float = 1.0,
    contrast: float = 1.0,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    keep: Literal['level', 'none'] = 'level',
    drift: FileName | Literal[False] = False,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Remove low-frequency variation (gradients of light, stains) from an image.

    Local level and local contrast of Lab, as medians over a disc, are brought to those of the whole image. Elements
    smaller than the disc are kept; stains larger than it are removed with their rims. The result is the image times a
    smooth gain plus a smooth offset in Lab. The gain lies between 1/2 and 2. Memory does not grow with the image.

    Parameters
    ----------
    source : ImageLike
        Image to flatten.
    mask : ImageLike | None, default None
        where pixels may come from: above one half of the first channel's range; of ids: all but 0; a text is the name of a part of the first image, else of a file
    radius : float | None, default None
        Radius of the disc. Smaller structures are kept. Default: 0.2 x longer side.; a number >= 1 and <= 1000000 px
    amount : float, default 1.0
        Share of the drift that is removed. Default: 1.; a number >= 0 and <= 1
    contrast : float, default 1.0
        Share of the variation in local contrast that is removed. Default: 1.; a number >= 0 and <= 1
    tile : Literal['none', 'x', 'y', 'xy'], default 'none'
        Axes along which the image tiles; the result then tiles, too. Default: none.
    keep : Literal['level', 'none'], default 'level'
        Overall color of the result. level: the median of the local levels; none: middle gray (L 50, a 0, b 0), so that photos compare. Default: level.
    drift : bool | FileName, default False
        1: the correction as part 'drift' of the result; a file name: there. Default: 0.
    data : bool, default False
        Treat the channels as data, not color. Default: 0.
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        flat: the image without its drift, in its own color space and type; other channels are copied [pixels]
        drift: the correction: Lab x gain + offset, channels gain.L, gain.a, gain.b, offset.L, offset.a, offset.b [32-bit float values; with drift]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def flatten(
    source: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    radius: float | None = None,
    amount: float = 1.0,
    contrast: float = 1.0,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    keep: Literal['level', 'none'] = 'level',
    drift: Literal[True],
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def flatten(
    source: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    radius: float | None = None,
    amount: float = 1.0,
    contrast: float = 1.0,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    keep: Literal['level', 'none'] = 'level',
    drift: bool | FileName = False,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

def graph(
    *photos: ImageLike,
    graph: FileName | None = None,
    json: FileName | None = None,
    scale: float | Sequence[float] | None = None,
    loop: int | None = None,
    scales: int = 1,
    side: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    thumb: int = 128,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Make a first exemplar graph from photos, coarsest first, or from one; draw a graph as a picture.

    Several photos become a chain: each is finer than the one before by `scale`. One photo gets an edge to itself, a
    zoom without end; with `scales` a chain of exemplars is cut out of it, from the whole, reduced, down to a piece at
    full size. json=FILE is the document for `synth` and `zoom`, to be edited at will; the files that it names
    are looked up beside it (HRRG08: Han, Risser, Ramamoorthi, Grinspun, Multiscale Texture Synthesis, 2008, section
    3.1, figures 8 and 9). The picture shows exemplars by their octaves, with r at the edges.

    Parameters
    ----------
    *photos : ImageLike
        the photos, coarsest first; none is taken where graph says them
    graph : FileName | None, default None
        draw this graph, JSON or YAML, instead of making one
    json : FileName | None, default None
        the graph goes to this file
    scale : float | Sequence[float] | None, default None
        how many times smaller the pixels of each photo are than those before, or one for all; 8; a number or a sequence of them >= 1
    loop : int | None, default None
        r of an edge from the last exemplar to itself; 0: none; 1 for one photo, else 0; a whole number >= 0 and <= 7
    scales : int, default 1
        cut so many exemplars out of one photo, scale apart (2): written by json; a whole number >= 1 and <= 16
    side : Literal[16, 32, 64, 128, 256, 512, 1024], default 256
        of an exemplar, at most; 16 | 32 | 64 | 128 | 256 | 512 | 1024
    thumb : int, default 128
        side of an exemplar in the picture; a whole number >= 32 and <= 512 px
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        picture: exemplars and edges [8-bit sRGB picture]
        graph: the document for `synth` and `zoom` [JSON; with json]
        exemplar.N: with scales: the photo N times reduced, beside it [pixels; with json]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

def join(
    *shares: ImageLike,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]:
    """Put the shares of an image together, as a farm has rendered them: the same pixels as of one run.

    Takes all images of the stack, in any order: crops in one display window, as `synth` with tiles=1/8 to tiles=8/8
    makes them. They must cover it. Where they overlap they must be equal, and they must have the same channels,
    pixel type and parts; what does not fit is refused by name.

    Parameters
    ----------
    *shares : ImageLike
        the shares, in any order
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        joined: all parts of the shares, whole [pixels]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

@overload
def lab(
    source: Picture,
    /,
    *,
    inverse: bool = False,
    to: str | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Turn color into CIE Lab (D65), and back.

    L is 0 for black and 100 for diffuse white, a and b are 0 for gray; HDR values lie above 100, and negative ones
    survive. L, a and b are stored as 32-bit floats in the channels R, G and B, as OpenColorIO does it: a channel that
    is named 'a' is taken for alpha by most programs. Gray becomes three channels. Color is unpremultiplied first and
    premultiplied again on the way back; alpha and other channels stay. The result is tagged as data, so that nobody
    takes it for RGB, and remembers the space that it came from for the way back.

    Parameters
    ----------
    source : ImageLike
        the image
    inverse : bool, default False
        from Lab to color
    to : str | None, default None
        with `inverse`: the color space to go to; the one that the image came from when left out
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        lab: L, a and b in the channels R, G and B [32-bit float values]
        color: written in the type of the run's first file [pixels; with inverse]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def lab(
    source: ImageLike,
    /,
    *,
    inverse: bool = False,
    to: str | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

@overload
def label(
    source: ImageLike,
    /,
    *,
    features: Literal['textons', 'moments', 'gabor', 'quadtree'] = 'textons',
    cluster: Literal['nmf', 'kmeans', 'spectral'] = 'nmf',
    persistence: float = 0.95,
    share: float = 0.5,
    coarsest: bool = True,
    labels: int | None = None,
    neighbors: int = 256,
    tries: int = 0,
    runs: int = 1,
    minsize: int | None = None,
    seed: int = 0,
    paper: bool = False,
    keep: Literal[True],
    soft: bool = False,
    cryptomatte: bool | FileName = False,
    names: FileName | None = None,
    single: Literal[False] = False,
    json: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]:
    """Find what an image consists of, and label it at several scales.

    Superpixels that look alike get one label; how many there are follows from the image (LSA16: Lockerman, Sauvage,
    Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016). The
    result has one part per scale: label.1 is the finest, the last one the coarsest, and every label of a level lies
    in one label of the next, its parent. Ids are 1, 2, ... of type uint32; 0 stands only where alpha is 0. Write it
    to EXR or TIFF, which hold them. With `keep` the photo stays the first part. Attributes of a part say its scale
    (oiiotex:rho, px), how many labels it has (oiiotex:labels) and their parents, in order (oiiotex:parents).

    Parameters
    ----------
    source : ImageLike
        the image
    features : Literal['textons', 'moments', 'gabor', 'quadtree'], default 'textons'
        what superpixels are compared by; moments: the paper's
    cluster : Literal['nmf', 'kmeans', 'spectral'], default 'nmf'
        how alike ones are gathered; the last two need scikit-learn, and get the count from the first
    persistence : float, default 0.95
        how short the random walk is: less gives fewer labels; level n takes its nth power; a number >= 0.01 and <= 0.999
    share : float, default 0.5
        of the superpixels of the next scale that must hold two labels; the paper: 1; a number >= 0.01 and <= 1
    coarsest : bool, default True
        a coarsest level of subtextures, as `decompose` finds them; not in the paper
    labels : int | None, default None
        how many subtextures that level has, at most; found when left out; a whole number >= 1 and <= 50
    neighbors : int, default 256
        of a superpixel in the graph, at most; a whole number >= 8 and <= 4096
    tries : int, default 0
        random starts that are joined with the first (boosting); a whole number >= 0 and <= 100
    runs : int, default 1
        of SLIC, the best is taken; the paper: 10; a whole number >= 1 and <= 1000
    minsize : int | None, default None
        smaller superpixels join a neighbor; sigma^2 / 4 when left out, 25 in the paper; a whole number >= 1 px
    seed : int, default 0
        of random starts; with tries=0 and runs=1 there are none; a whole number >= 0 and <= 4294967295
    paper : bool, default False
        LSA16 by the letter: features=moments:persistence=0.95:share=1:coarsest off:neighbors=256:runs=10:minsize=25, one persistence at all levels, and labels cut wherever a coarser border crosses them
    keep : bool, default False
        the photo stays the first part, the labels follow it
    soft : bool, default False
        further parts: membership.N (G) and fit.N (F / its largest) of level N
    cryptomatte : bool | FileName, default False
        1: a further part with Cryptomatte 1.2 of all levels; a file name: its manifest goes there
    names : FileName | None, default None
        table of `palette`: what labels are called, in parts and in Cryptomatte
    single : bool, default False
        with cryptomatte: one nameless part of the image's channels and Cryptomatte's, as Blender and Nuke take it at once
    json : FileName | None, default None
        scales, counts, areas and the tree of labels go to this file
    data : bool, default False
        the channels are no colors: compare them as they are
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        photo: the photo, before all others [pixels; with keep]
        label.N: at scale N; 1 is the finest [32-bit ids]
        membership.N: of level N: G, a channel for every label [32-bit float values; with soft]
        fit.N: of level N: F / its largest, a channel for every label [32-bit float values; with soft]
        cryptomatte: all levels [Cryptomatte 1.2; with cryptomatte]
        facts: scales, counts, areas and the tree of labels [JSON; with json]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def label(
    source: ImageLike,
    /,
    *,
    features: Literal['textons', 'moments', 'gabor', 'quadtree'] = 'textons',
    cluster: Literal['nmf', 'kmeans', 'spectral'] = 'nmf',
    persistence: float = 0.95,
    share: float = 0.5,
    coarsest: bool = True,
    labels: int | None = None,
    neighbors: int = 256,
    tries: int = 0,
    runs: int = 1,
    minsize: int | None = None,
    seed: int = 0,
    paper: bool = False,
    keep: bool = False,
    soft: bool = False,
    cryptomatte: Literal[True],
    names: FileName | None = None,
    single: Literal[False] = False,
    json: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def label(
    source: ImageLike,
    /,
    *,
    features: Literal['textons', 'moments', 'gabor', 'quadtree'] = 'textons',
    cluster: Literal['nmf', 'kmeans', 'spectral'] = 'nmf',
    persistence: float = 0.95,
    share: float = 0.5,
    coarsest: bool = True,
    labels: int | None = None,
    neighbors: int = 256,
    tries: int = 0,
    runs: int = 1,
    minsize: int | None = None,
    seed: int = 0,
    paper: bool = False,
    keep: bool = False,
    soft: bool = False,
    cryptomatte: bool | FileName = False,
    names: FileName | None = None,
    single: bool = False,
    json: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

def labelview(
    source: ImageLike,
    /,
    *,
    side: int = 384,
    columns: int = 3,
    strength: float = 0.65,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Show label maps to people: a contact sheet of all levels, with the tree of labels beside it.

    Takes the image that `label` or `superpixel` makes, best with `keep`: the photo, then for every label part
    (uint32, one channel) its labels in colors that stay apart for color-blind viewers too, over the photo's lightness
    and with their borders. The tree has the coarsest labels at its top; a node is as wide as the label's share of the
    image. The result is an 8-bit sRGB image for screens, made from every nth pixel: do not measure it.

    Parameters
    ----------
    source : ImageLike
        an image with label parts, as `label` or `superpixel` with `keep` makes it
    side : int, default 384
        longer side of one panel; a whole number >= 64 and <= 4096 px
    columns : int, default 3
        panels in a row; a whole number >= 1 and <= 16
    strength : float, default 0.65
        of the labels' colors over the photo; a number >= 0 and <= 1
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        view: the sheet [8-bit sRGB picture]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

@overload
def paint(
    exemplar: ImageLike,
    painting: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    fine: ImageLike | None = None,
    level: int | None = None,
    table: FileName | None = None,
    soft: float = 0.2,
    size: tuple[int, int] | None = None,
    plan: FileName | None = None,
    before: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    reuse: float = 1.0,
    finer: float = 0.5,
    guidance: float = 1.0,
    keep: Literal[False] = False,
    data: bool = False,
    seed: int = 0,
    stmap: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Turn a painting of labels into a texture, at one scale or at two.

    What the painting calls label 3 becomes texture of label 3 of the photo, by guided quilting (`quilt`). A second
    painting, fine, lays labels of the next finer level over it; where it is empty (black, id 0 or alpha 0), the first
    stays (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for
    Texture Synthesis, SIGGRAPH 2016, section 6.2). table=FILE is what `palette` wrote: which color is which
    label; paintings of ids need none. With plan=FILE the next edit begins there: before=FILE keeps every patch whose
    labels did not change, so that pixels elsewhere are the same to the bit.

    Parameters
    ----------
    exemplar : ImageLike
        the photo; where labels are spoken of, with label maps as `label` with `keep` makes them
    painting : ImageLike
        ids of labels, or colors that table gives a meaning; of any size
    labels : ImageLike | None, default None
        label maps of the exemplar, where they are not parts of it; a text is the name of a part of the first image, else of a file
    fine : ImageLike | None, default None
        a painting of labels of the next finer level that is laid over it; a text is the name of a part of the first image, else of a file
    level : int | None, default None
        which label map is painted: label.N; the table's, else the coarsest, when left out; a whole number >= 1
    table : FileName | None, default None
        JSON of `palette`: which label each color of the paintings means
    soft : float, default 0.2
        how far a color of a painting may be from one of the table to be taken for the nearest, in Oklab, where black and white are 1 apart: what soft brushes blend is within 0.2 of `palette`'s colors; 0: none; a number >= 0 and <= 1
    size : tuple[int, int] | None, default None
        of the result; the painting's when left out; (width, height) >= 8 and <= 4194304 px
    plan : FileName | None, default None
        what was painted, and with which patches, goes to this file (.npz)
    before : FileName | None, default None
        such a file: what is painted as it was keeps its patches
    report : FileName | None, default None
        measures of the result go to this file, JSON (docs/reference/report.md)
    fail : Sequence[str] | None, default None
        limits of measures, NAME>NUMBER or NAME<NUMBER, such as seam>1.3 and repeat>4: beyond one the run exits 3
    tile : Literal['none', 'x', 'y', 'xy'], default 'none'
        along which axes the result tiles
    patch : int | None, default None
        side of a patch; the label level's scale, or shorter side / 8, as a power of two when left out (less where a guide's labels are found in too few places); a whole number >= 8 and <= 256 px
    candidates : int, default 256
        patches that are tried in a place, at most; a whole number >= 1 and <= 65536
    reuse : float, default 1.0
        a region of the exemplar that is shown oftener than twice, and than once more than this times its fair share, costs, the more the oftener; a number >= 0 and <= 1000000000
    finer : float, default 0.5
        weight of finer levels' labels in the overlaps, beside color; a number >= 0 and <= 100
    guidance : float, default 1.0
        weight of the guide's labels inside a patch, beside color; a number >= 0 and <= 100
    keep : bool, default False
        label parts of the exemplar follow, made from the same sources
    data : bool, default False
        the channels are no colors: compare them as they are
    seed : int, default 0
        same seed, same pixels; a whole number >= 0 and <= 4294967295
    stmap : bool | FileName, default False
        1: source coordinates as part 'st' of the result; a file name: there
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        paint: pixels copied from the photo, all channels together, in its own color space and type [pixels]
        st: where every pixel comes from, as `warp` and `st_warp` read it [32-bit float coordinates; with stmap]
        label.N: label parts of the photo, made from the same sources [32-bit ids; with keep]
        plan: what was painted, and with which patches [.npz; with plan]
        report: measures of the result, for machines [JSON; with report]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def paint(
    exemplar: ImageLike,
    painting: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    fine: ImageLike | None = None,
    level: int | None = None,
    table: FileName | None = None,
    soft: float = 0.2,
    size: tuple[int, int] | None = None,
    plan: FileName | None = None,
    before: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    reuse: float = 1.0,
    finer: float = 0.5,
    guidance: float = 1.0,
    keep: bool = False,
    data: bool = False,
    seed: int = 0,
    stmap: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def paint(
    exemplar: ImageLike,
    painting: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    fine: ImageLike | None = None,
    level: int | None = None,
    table: FileName | None = None,
    soft: float = 0.2,
    size: tuple[int, int] | None = None,
    plan: FileName | None = None,
    before: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    reuse: float = 1.0,
    finer: float = 0.5,
    guidance: float = 1.0,
    keep: bool = False,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

@overload
def palette(
    exemplar: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    side: int = 96,
    rows: int = 24,
    children: int = 8,
    chips: FileName | Literal[False] = False,
    paints: FileName | None = None,
    json: FileName | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Lay out what a texture consists of: a band for every label, beside it the labels within.

    Every row is a label of one level, its texture synthesized from its pixels alone;
    right of it are its children on the next finer level, side by side (LSA16: Lockerman, Sauvage, Allegre, Dischler,
    Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016, section 6.2, figures 13
    and 14). The largest label is on top. json=FILE says for each its id, name, color to paint with, area, parent,
    children and place in the picture: the table of `paint`. paints=FILE is a palette for painting programs, `chips`
    a picture of the same colors.

    Parameters
    ----------
    exemplar : ImageLike
        the photo; where labels are spoken of, with label maps as `label` with `keep` makes them
    labels : ImageLike | None, default None
        label maps of the exemplar, where they are not parts of it; a text is the name of a part of the first image, else of a file
    side : int, default 96
        height of a row; a whole number >= 16 and <= 1024 px
    rows : int, default 24
        labels that are shown, the largest first; a whole number >= 1 and <= 256
    children : int, default 8
        children that are shown of each, the largest first; a whole number >= 0 and <= 64
    chips : bool | FileName, default False
        1: a further part with the paint colors, ids and names in them; a file name: there
    paints : FileName | None, default None
        the paint colors go to this file, .gpl or .aco: load it where you paint
    json : FileName | None, default None
        ids, names, colors, areas, parents, children and boxes go to this file
    level : int | None, default None
        which label map: label.N of the exemplar or of labels; the coarsest when left out; a whole number >= 1
    data : bool, default False
        the channels are no colors: compare them as they are
    seed : int, default 0
        same seed, same pixels; a whole number >= 0 and <= 4294967295
    stmap : bool | FileName, default False
        1: source coordinates as part 'st' of the result; a file name: there
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        palette: rows of texture, copied from the photo, in its own color space and type [pixels]
        st: where every pixel comes from, as `warp` and `st_warp` read it [32-bit float coordinates; with stmap]
        chips: the paint colors with ids and names, each as large as its swatch [8-bit sRGB picture; with chips]
        paints: the paint colors by name, for GIMP, Krita and Inkscape, or Photoshop [.gpl or .aco; with paints]
        table: ids, names, colors, areas, parents, children and boxes of labels [JSON; with json]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def palette(
    exemplar: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    side: int = 96,
    rows: int = 24,
    children: int = 8,
    chips: Literal[True],
    paints: FileName | None = None,
    json: FileName | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def palette(
    exemplar: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    side: int = 96,
    rows: int = 24,
    children: int = 8,
    chips: bool | FileName = False,
    paints: FileName | None = None,
    json: FileName | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def palette(
    exemplar: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    side: int = 96,
    rows: int = 24,
    children: int = 8,
    chips: bool | FileName = False,
    paints: FileName | None = None,
    json: FileName | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

@overload
def patchmatch(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    within: ImageLike | None = None,
    weight: ImageLike | None = None,
    contrast: float = 1.0,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tile: Literal['xy', 'x', 'y', 'none'] | None = None,
    variants: Literal[1] = 1,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    uniformity: float = 0.01,
    reuse: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    n: Literal[1] = 1,
    kinds: Sequence[str] | None = None,
    match: float | Sequence[float] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """The photo synthesized anew by PatchMatch alone: the paper's baselines (MJH17 section 5.2).

    The same as `stationarize` without its projection. `tile=xy` is toroidal PatchMatch, `tile=none` the plain one.

    Parameters
    ----------
    exemplar : ImageLike
        the photo; of n maps of a material, the first
    mask : ImageLike | None, default None
        where pixels may come from: above one half of the first channel's range; of ids: all but 0; a text is the name of a part of the first image, else of a file
    labels : ImageLike | None, default None
        label maps of the exemplar, where they are not parts of it; a text is the name of a part of the first image, else of a file
    within : ImageLike | None, default None
        make only these pixels anew, from patches outside of them, and leave the rest to the bit: above one half of the first channel's range; of ids: all but 0; a text is the name of a part of the first image, else of a file
    weight : ImageLike | None, default None
        how often pixels of the photo are used beside others, by the first channel: 0 never, 2 twice as often as 1; a text is the name of a part of the first image, else of a file
    maps : Sequence[ImageLike], default ()
        the other maps of the material, made anew with it
    contrast : float, default 1.0
        how strongly the histogram is held to the photo's at first; it fades out; a number >= 0 and <= 1
    relevel : bool, default False
        1: every copied piece of a height map is raised or lowered as a whole, for its seams to close as far as constants can: its pixels are then copies plus a constant; goes with kinds=...,height
    size : Literal['pow2'] | tuple[int, int] | None, default None
        size of the result. pow2: the nearest power of two of each side of the photo. Default: the photo's size; 'pow2' or (width, height) >= 5 and <= 65536 px
    tile : Literal['xy', 'x', 'y', 'none'] | None, default None
        along which axes the result tiles; when left out xy, with within none
    variants : int, default 1
        so many different tiles that go beside each other: up to 7 any beside any; from 8 on edges have two colors (16 is the whole set of Wang tiles), which part names and the attribute oiiotex:edges say; a whole number >= 1 and <= 64
    patch : Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None, default None
        Side of a patch: the scale up to which detail is copied whole. Default: 13.; 5 | 7 | 9 | 11 | 13 | 15 | 17 | 19 | 21
    iterations : int, default 30
        Iterations on the coarsest level; each finer level has one. Default: 30.; a whole number >= 1 and <= 1000
    uniformity : float, default 0.01
        how strongly the use of all parts of the exemplar is evened out; above 0.1 it costs coherence; a number >= 0 and <= 1
    reuse : float, default 1.0
        Weight of the penalty on regions of the photo that are shown more than 2 times. 0: none; the result is closer to the photo and repeats more. Default: 1.; a number >= 0 and <= 1
    resume : bool, default False
        keep finished levels in OUT.parts until OUT is whole: a run that was killed goes on from there
    report : FileName | None, default None
        measures of the result go to this file, JSON (docs/reference/report.md)
    fail : Sequence[str] | None, default None
        limits of measures, NAME>NUMBER or NAME<NUMBER, such as seam>1.3 and repeat>4: beyond one the run exits 3
    n : int, default 1
        how many maps of one material are made together, the last images of the stack; a whole number >= 1 and <= 16
    kinds : Sequence[str] | None, default None
        what the maps are, in their order: color (or color), data, normal or height; when left out the first is as without further maps, the others are data. What is no color is tagged as data
    match : float | Sequence[float] | None, default None
        how much the maps count when patches are compared, in their order; 0: not at all; when left out 1 for every map, 0.25 for a height; a number or a sequence of them >= 0
    label : int | None, default None
        take only pixels of that label, by its id; a whole number >= 1
    level : int | None, default None
        which label map: label.N of the exemplar or of labels; the coarsest when left out; a whole number >= 1
    data : bool, default False
        the channels are no colors: compare them as they are
    seed : int, default 0
        same seed, same pixels; a whole number >= 0 and <= 4294967295
    stmap : bool | FileName, default False
        1: source coordinates as part 'st' of the result; a file name: there
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]
        a dict where more than one part was asked for
        a list of these where there are several images
        tile: pixels copied from the photo, all channels together, in its own color space and type; of n maps n images, in their order; of variants that many [pixels]
        st: where every pixel comes from, as `warp` and `st_warp` read it [32-bit float coordinates; with stmap]
        report: measures of the result, for machines [JSON; with report]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def patchmatch(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    within: ImageLike | None = None,
    weight: ImageLike | None = None,
    contrast: float = 1.0,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tile: Literal['xy', 'x', 'y', 'none'] | None = None,
    variants: Literal[1] = 1,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    uniformity: float = 0.01,
    reuse: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    n: Literal[1] = 1,
    kinds: Sequence[str] | None = None,
    match: float | Sequence[float] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def patchmatch(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    within: ImageLike | None = None,
    weight: ImageLike | None = None,
    maps: Sequence[ImageLike] = (),
    contrast: float = 1.0,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tile: Literal['xy', 'x', 'y', 'none'] | None = None,
    variants: int = 1,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    uniformity: float = 0.01,
    reuse: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    n: int = 1,
    kinds: Sequence[str] | None = None,
    match: float | Sequence[float] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]: ...

def preview(
    tile: ImageLike,
    /,
    *,
    exemplar: ImageLike | None = None,
    panels: Sequence[str] | None = None,
    height: int = 512,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Lay a tile out as it will be seen: 2 x 2, 3 x 3, and on a plane in perspective to the horizon.

    The plane is the stress test of MJH17 (section 5.2): all repetition shows there. With `exemplar` the photo stands
    beside it, and what a paint program's 'make seamless' makes of it, 2 x 2: the photo blended with itself shifted by
    half. Every pixel is the mean of all it covers. Values are averaged as they are stored: of a picture that is not
    linear convert a copy first (OpenImageIO's `colorconvert`), where the light at the horizon must be right.

    Parameters
    ----------
    tile : ImageLike
        the tile
    exemplar : ImageLike | None, default None
        the photo that it was made from; a text is the name of a part of the first image, else of a file
    panels : Sequence[str] | None, default None
        which, in their order: exemplar, seamless, 2x2, 3x3, plane; when left out all there can be
    height : int, default 512
        of each panel; a whole number >= 16 and <= 16384 px
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        preview: the panels side by side, in the tile's color space and type [pixels]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

@overload
def quilt(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    guide: ImageLike | None = None,
    label: int | None = None,
    table: FileName | None = None,
    soft: float = 0.2,
    overlap: int | None = None,
    plan: FileName | None = None,
    render: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    size: tuple[int, int] | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    reuse: float = 1.0,
    finer: float = 0.5,
    guidance: float = 1.0,
    keep: Literal[False] = False,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: FileName | Literal[False] = False,
    structure: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Sew a texture of any size together from patches of a photo, as a stream.

    Image quilting (Efros & Freeman, SIGGRAPH 2001): square patches on a regular grid, each the one that fits what is
    there best, cut along the line where both look most alike. With label maps (of `label`) a guide says what is
    to be where: patches are looked up by their content, the two most frequent labels in them (LSA16: Lockerman,
    Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH
    2016, section 6.1). Every pixel of the result is a copy of one pixel of the photo, and the result does not depend
    on memory or threads. A plan of offsets and cuts is all that is kept, so memory does not grow with the pixels.

    Parameters
    ----------
    exemplar : ImageLike
        the photo; where labels are spoken of, with label maps as `label` with `keep` makes them
    mask : ImageLike | None, default None
        where pixels may come from: above one half of the first channel's range; of ids: all but 0; a text is the name of a part of the first image, else of a file
    labels : ImageLike | None, default None
        label maps of the exemplar, where they are not parts of it; a text is the name of a part of the first image, else of a file
    guide : ImageLike | None, default None
        what is to be where: ids of labels, or ids or colors that table gives a meaning; of any size; a text is the name of a part of the first image, else of a file
    label : int | None, default None
        take only pixels of that label, by its id; a whole number >= 1
    table : FileName | None, default None
        JSON: {"255,0,0": 3, "0,0,255": [1, 2]}: which label or key ids or 8-bit colors of the guide mean
    soft : float, default 0.2
        how far a color of a painting may be from one of the table to be taken for the nearest, in Oklab, where black and white are 1 apart: what soft brushes blend is within 0.2 of `palette`'s colors; 0: none; a number >= 0 and <= 1
    overlap : int | None, default None
        of neighbors, at most patch / 3; patch / 4 when left out; a whole number >= 4 and <= 85 px
    plan : FileName | None, default None
        the plan goes to this file (.npz): offsets and cuts
    render : bool, default False
        make the result from the plan in that file, of the photo or of any map of its size
    report : FileName | None, default None
        measures of the result go to this file, JSON (docs/reference/report.md)
    fail : Sequence[str] | None, default None
        limits of measures, NAME>NUMBER or NAME<NUMBER, such as seam>1.3 and repeat>4: beyond one the run exits 3
    size : tuple[int, int] | None, default None
        of the result; the guide's or else the exemplar's when left out; (width, height) >= 1 and <= 4194304 px
    tile : Literal['none', 'x', 'y', 'xy'], default 'none'
        along which axes the result tiles
    patch : int | None, default None
        side of a patch; the label level's scale, or shorter side / 8, as a power of two when left out (less where a guide's labels are found in too few places); a whole number >= 8 and <= 256 px
    candidates : int, default 256
        patches that are tried in a place, at most; a whole number >= 1 and <= 65536
    reuse : float, default 1.0
        a region of the exemplar that is shown oftener than twice, and than once more than this times its fair share, costs, the more the oftener; a number >= 0 and <= 1000000000
    finer : float, default 0.5
        weight of finer levels' labels in the overlaps, beside color; a number >= 0 and <= 100
    guidance : float, default 1.0
        weight of the guide's labels inside a patch, beside color; a number >= 0 and <= 100
    keep : bool, default False
        label parts of the exemplar follow, made from the same sources
    level : int | None, default None
        which label map: label.N of the exemplar or of labels; the coarsest when left out; a whole number >= 1
    data : bool, default False
        the channels are no colors: compare them as they are
    seed : int, default 0
        same seed, same pixels; a whole number >= 0 and <= 4294967295
    stmap : bool | FileName, default False
        1: source coordinates as part 'st' of the result; a file name: there
    structure : float, default 0.5
        strength with which regular repeats of the photo (tiles, courses, weaves) are kept; 0: not at all. Where the photo's size would stretch them visibly, the default size is the nearest that holds complete repeats only. No effect on a photo without regular repeats; a number >= 0 and <= 1
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        quilt: pixels copied from the photo, all channels together, in its own color space and type [pixels]
        st: where every pixel comes from, as `warp` and `st_warp` read it [32-bit float coordinates; with stmap]
        label.N: label parts of the photo, made from the same sources [32-bit ids; with keep]
        plan: offsets and cuts [.npz; with plan]
        report: measures of the result, for machines [JSON; with report]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def quilt(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    guide: ImageLike | None = None,
    label: int | None = None,
    table: FileName | None = None,
    soft: float = 0.2,
    overlap: int | None = None,
    plan: FileName | None = None,
    render: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    size: tuple[int, int] | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    reuse: float = 1.0,
    finer: float = 0.5,
    guidance: float = 1.0,
    keep: bool = False,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: Literal[True],
    structure: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def quilt(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    guide: ImageLike | None = None,
    label: int | None = None,
    table: FileName | None = None,
    soft: float = 0.2,
    overlap: int | None = None,
    plan: FileName | None = None,
    render: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    size: tuple[int, int] | None = None,
    tile: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    reuse: float = 1.0,
    finer: float = 0.5,
    guidance: float = 1.0,
    keep: bool = False,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    structure: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

@overload
def rectify(
    source: ImageLike,
    /,
    *,
    corners: float | Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    physical: float | Sequence[float] | None = None,
    filter: Literal['lanczos3', 'mitchell', 'triangle'] = 'lanczos3',
    stmap: FileName | Literal[False] = False,
    json: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Show a flat surface from the front that was photographed at a slant.

    Four corners of what is a rectangle in the world become those of the result; width over height follows from the
    perspective itself (Zhang and He 2007: square pixels, the photo not cropped), or from physical=. Without corners a
    photo of what repeats at equal distances in two directions (tiles, bricks, a weave) is straightened by its lattice,
    and the result has as many whole cells of it as fit into the photo, so that it closes on itself along both axes.
    With physical= the size of a pixel goes into the metadata (XResolution, YResolution, ResolutionUnit), which
    all filters hand on. Values are filtered as they are stored; normals and displacements keep their directions.

    Parameters
    ----------
    source : ImageLike
        the photo
    corners : float | Sequence[float] | None, default None
        x,y of top left, top right, bottom right, bottom left, from the display window's corner; by the photo's lattice when left out; a number or a sequence of them px
    size : tuple[int, int] | None, default None
        width x height of the result; as large as the longer sides are seen when left out; (width, height) >= 1 and <= 65536
    physical : float | Sequence[float] | None, default None
        width,height in meters of what the corners span; of the lattice, of a cell; a number or a sequence of them >= 1e-09 and <= 1000000000 m
    filter : Literal['lanczos3', 'mitchell', 'triangle'], default 'lanczos3'
        what pixels are resampled by
    stmap : bool | FileName, default False
        1: source coordinates as part 'st' of the result; a file name: there
    json : FileName | None, default None
        corners, size, cells, meters and the matrix go to this file
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        rectified: the surface from the front, in the photo's own color space and type [pixels]
        st: where every pixel comes from, between pixels, as `st_warp` reads it [32-bit float coordinates; with stmap]
        geometry: corners, size, cells, meters, matrix [JSON; with json]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def rectify(
    source: ImageLike,
    /,
    *,
    corners: float | Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    physical: float | Sequence[float] | None = None,
    filter: Literal['lanczos3', 'mitchell', 'triangle'] = 'lanczos3',
    stmap: Literal[True],
    json: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def rectify(
    source: ImageLike,
    /,
    *,
    corners: float | Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    physical: float | Sequence[float] | None = None,
    filter: Literal['lanczos3', 'mitchell', 'triangle'] = 'lanczos3',
    stmap: bool | FileName = False,
    json: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

def sigmas(
    exemplar: ImageLike,
    /,
    *,
    n: int = 9,
    size: tuple[int, int] | None = None,
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    seed: int = 0,
    columns: int = 3,
    json: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Show what each sigma of `stationarize` makes of a photo, and find sigmas whose steps look even.

    A contact sheet of n small tiles, from the largest sigma (amount 0) to the smallest (amount 1), laid out 2 x 2. How
    much a tile changes with sigma hangs on the photo: neighbors are compared by the earth mover's distance between
    their histograms, and sigmas are spread anew so that the steps are even (MJH17: Moritz, James, Haines, Ritschel,
    Weyrich, Texture Stationarization, Eurographics 2017, section 4.4). Its `amount` finds its sigma on the
    same scale, which is kept in the user's cache. The table is printed; json keeps it. The result is an 8-bit sRGB
    image for screens: do not measure it.

    Parameters
    ----------
    exemplar : ImageLike
        the photo
    n : int, default 9
        how many sigmas; a whole number >= 3 and <= 32
    size : tuple[int, int] | None, default None
        of the tile they are for; the photo's own when left out; (width, height) >= 5 and <= 65536 px
    measure : Literal['histogram', 'moments', 'steerable'], default 'histogram'
        what must look the same everywhere: local histograms, local moments, or responses of steerable filters
    order : int | None, default None
        of measure=moments: up to which; 2 (mean and variance) when left out, 3 adds skewness, 4 kurtosis; a whole number >= 2 and <= 4
    seed : int, default 0
        same seed, same pixels; a whole number >= 0 and <= 4294967295
    columns : int, default 3
        tiles in a row; a whole number >= 1 and <= 32
    json : FileName | None, default None
        the table goes to this file
    data : bool, default False
        the channels are no colors: compare them as they are
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        view: the sheet [8-bit sRGB picture]
        table: sigmas and amounts [JSON; with json]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

def stationarity(
    source: ImageLike,
    /,
    *,
    sigma: float | None = None,
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Map how far an image is from looking the same everywhere.

    The value of a pixel is the mean difference between what is seen there through a Gaussian of sigma and what is seen
    elsewhere: 0 where the image is as it is everywhere, high in stains, shadows and odd patches. The difference is the
    earth mover's distance between Lab histograms, or that between histograms of the responses of steerable filters,
    or the squared difference of local moments. Its mean is the stationarity cost of MJH17 (eq. 1), which is logged
    with -v and stored in the attribute oiiotex:stationarity of the result.

    Parameters
    ----------
    source : ImageLike
        the image
    sigma : float | None, default None
        scale at which the image is looked at; longer side / 32 when left out; a number >= 1 and <= 1000000 px
    measure : Literal['histogram', 'moments', 'steerable'], default 'histogram'
        what must look the same everywhere: local histograms, local moments, or responses of steerable filters
    order : int | None, default None
        of measure=moments: up to which; 2 (mean and variance) when left out, 3 adds skewness, 4 kurtosis; a whole number >= 2 and <= 4
    data : bool, default False
        the channels are no colors: compare them as they are
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        deviation: one channel in Lab units (moments: squared), of the image's windows [32-bit float values]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

@overload
def stationarize(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    within: ImageLike | None = None,
    weight: ImageLike | None = None,
    sigmamap: ImageLike | None = None,
    flatten: float | None = None,
    drift: FileName | Literal[False] = False,
    sigma: float | None = None,
    amount: float | None = None,
    contrast: float | None = None,
    target: Literal['flat', 'exemplar'] = 'flat',
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    structure: float = 0.5,
    preset: Literal['even', 'clean', 'keep'] | None = None,
    paper: bool = False,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tile: Literal['xy', 'x', 'y', 'none'] | None = None,
    variants: Literal[1] = 1,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    uniformity: float = 0.01,
    reuse: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    n: Literal[1] = 1,
    kinds: Sequence[str] | None = None,
    match: float | Sequence[float] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Turn a photo into a texture that tiles without visible repetition.

    Gradients of light and stains repeat visibly when a photo is tiled. They are removed first (`flatten`), as by
    `flatten`. Then the photo is resynthesized from its own patches, while local histograms, or another measure, are
    kept uniform above a scale sigma (MJH17: Moritz, James, Haines, Ritschel, Weyrich, Texture Stationarization,
    Eurographics 2017). Every pixel of the result is a copy of one pixel of the photo, all its channels together; where
    drift is removed, the copy is corrected by a gain and an offset in Lab that vary slowly, but for the rims of stains.
    With `relevel`, heights are copies plus a constant for each copied piece.

    Parameters
    ----------
    exemplar : ImageLike
        the photo; of n maps of a material, the first
    mask : ImageLike | None, default None
        where pixels may come from: above one half of the first channel's range; of ids: all but 0; a text is the name of a part of the first image, else of a file
    labels : ImageLike | None, default None
        label maps of the exemplar, where they are not parts of it; a text is the name of a part of the first image, else of a file
    within : ImageLike | None, default None
        make only these pixels anew, from patches outside of them, and leave the rest to the bit: above one half of the first channel's range; of ids: all but 0; a text is the name of a part of the first image, else of a file
    weight : ImageLike | None, default None
        how often pixels of the photo are used beside others, by the first channel: 0 never, 2 twice as often as 1; a text is the name of a part of the first image, else of a file
    sigmamap : ImageLike | None, default None
        sigma for each pixel of the result, in px, by the first channel of floats; a text is the name of a part of the first image, else of a file
    maps : Sequence[ImageLike], default ()
        the other maps of the material, made anew with it
    flatten : float | None, default None
        Share of the photo's gradients and stains that is removed before synthesis, as by `flatten`. 0: every pixel is a verbatim copy. Default: 1; 0 with within and for data.; a number >= 0 and <= 1
    drift : bool | FileName, default False
        1: the correction as part 'drift' of the result; a file name: there. Default: 0.
    sigma : float | None, default None
        Scale in pixels above which the result is statistically uniform; structures below it are kept. Default: longer side / 8, with within / 32, at least patch / 4.; a number >= 0.5 and <= 1000000 px
    amount : float | None, default None
        instead of sigma: how stationary it shall look, in even steps that hang on the photo (see `sigmas`); a number >= 0 and <= 1
    contrast : float | None, default None
        How strongly the overall histogram is held to that of target. 0: colors of rare objects, such as windows in a wall, may vanish. Default: 0.7; 0 with within.; a number >= 0 and <= 1
    target : Literal['flat', 'exemplar'], default 'flat'
        the histogram that contrast holds to: that of the photo made stationary, or (as in the paper, fading out over the coarsest level) of the photo
    measure : Literal['histogram', 'moments', 'steerable'], default 'histogram'
        what must look the same everywhere: local histograms, local moments, or responses of steerable filters
    order : int | None, default None
        of measure=moments: up to which; 2 (mean and variance) when left out, 3 adds skewness, 4 kurtosis; a whole number >= 2 and <= 4
    structure : float, default 0.5
        strength with which regular repeats of the photo (tiles, courses, weaves) are kept; 0: not at all. Where the photo's size would stretch them visibly, the default size is the nearest that holds complete repeats only. No effect on a photo without regular repeats; a number >= 0 and <= 1
    preset : Literal['even', 'clean', 'keep'] | None, default None
        Modifiers for those that are not given. keep (large structures stay whole): sigma = longer side / 4, patch=21; even (structures beyond sigma are evened out, too): sigma = longer side / 32, patch=11; clean (objects are removed): as even, with contrast=0 and the mask of `dominant`. -v prints the line that makes the same pixels. Default: none of them.
    paper : bool, default False
        MJH17 by the letter: flatten=0:target=exemplar:contrast=1:structure=0, sigma longer side / 32, patch=11, a pyramid that starts at a quarter of the tile, 3 iterations on each finer level, no reuse penalties, no overshoot. Where the paper gives no number (alpha, uniformity) it is ours. Default: 0.
    relevel : bool, default False
        1: every copied piece of a height map is raised or lowered as a whole, for its seams to close as far as constants can: its pixels are then copies plus a constant; goes with kinds=...,height
    size : Literal['pow2'] | tuple[int, int] | None, default None
        size of the result. pow2: the nearest power of two of each side of the photo. Default: the photo's size; 'pow2' or (width, height) >= 5 and <= 65536 px
    tile : Literal['xy', 'x', 'y', 'none'] | None, default None
        along which axes the result tiles; when left out xy, with within none
    variants : int, default 1
        so many different tiles that go beside each other: up to 7 any beside any; from 8 on edges have two colors (16 is the whole set of Wang tiles), which part names and the attribute oiiotex:edges say; a whole number >= 1 and <= 64
    patch : Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None, default None
        Side of a patch: the scale up to which detail is copied whole. Default: 13.; 5 | 7 | 9 | 11 | 13 | 15 | 17 | 19 | 21
    iterations : int, default 30
        Iterations on the coarsest level; each finer level has one. Default: 30.; a whole number >= 1 and <= 1000
    uniformity : float, default 0.01
        how strongly the use of all parts of the exemplar is evened out; above 0.1 it costs coherence; a number >= 0 and <= 1
    reuse : float, default 1.0
        Weight of the penalty on regions of the photo that are shown more than 2 times. 0: none; the result is closer to the photo and repeats more. Default: 1.; a number >= 0 and <= 1
    resume : bool, default False
        keep finished levels in OUT.parts until OUT is whole: a run that was killed goes on from there
    report : FileName | None, default None
        measures of the result go to this file, JSON (docs/reference/report.md)
    fail : Sequence[str] | None, default None
        limits of measures, NAME>NUMBER or NAME<NUMBER, such as seam>1.3 and repeat>4: beyond one the run exits 3
    n : int, default 1
        how many maps of one material are made together, the last images of the stack; a whole number >= 1 and <= 16
    kinds : Sequence[str] | None, default None
        what the maps are, in their order: color (or color), data, normal or height; when left out the first is as without further maps, the others are data. What is no color is tagged as data
    match : float | Sequence[float] | None, default None
        how much the maps count when patches are compared, in their order; 0: not at all; when left out 1 for every map, 0.25 for a height; a number or a sequence of them >= 0
    label : int | None, default None
        take only pixels of that label, by its id; a whole number >= 1
    level : int | None, default None
        which label map: label.N of the exemplar or of labels; the coarsest when left out; a whole number >= 1
    data : bool, default False
        the channels are no colors: compare them as they are
    seed : int, default 0
        same seed, same pixels; a whole number >= 0 and <= 4294967295
    stmap : bool | FileName, default False
        1: source coordinates as part 'st' of the result; a file name: there
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]
        a dict where more than one part was asked for
        a list of these where there are several images
        tile: pixels copied from the photo, all channels together, in its own color space and type; of n maps n images, in their order; of variants that many [pixels]
        st: where every pixel comes from, as `warp` and `st_warp` read it [32-bit float coordinates; with stmap]
        report: measures of the result, for machines [JSON; with report]
        drift: the correction: Lab x gain + offset, channels gain.L, gain.a, gain.b, offset.L, offset.a, offset.b [32-bit float values; with drift]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def stationarize(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    within: ImageLike | None = None,
    weight: ImageLike | None = None,
    sigmamap: ImageLike | None = None,
    flatten: float | None = None,
    drift: Literal[True],
    sigma: float | None = None,
    amount: float | None = None,
    contrast: float | None = None,
    target: Literal['flat', 'exemplar'] = 'flat',
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    structure: float = 0.5,
    preset: Literal['even', 'clean', 'keep'] | None = None,
    paper: bool = False,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tile: Literal['xy', 'x', 'y', 'none'] | None = None,
    variants: Literal[1] = 1,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    uniformity: float = 0.01,
    reuse: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    n: Literal[1] = 1,
    kinds: Sequence[str] | None = None,
    match: float | Sequence[float] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def stationarize(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    within: ImageLike | None = None,
    weight: ImageLike | None = None,
    sigmamap: ImageLike | None = None,
    flatten: float | None = None,
    drift: bool | FileName = False,
    sigma: float | None = None,
    amount: float | None = None,
    contrast: float | None = None,
    target: Literal['flat', 'exemplar'] = 'flat',
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    structure: float = 0.5,
    preset: Literal['even', 'clean', 'keep'] | None = None,
    paper: bool = False,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tile: Literal['xy', 'x', 'y', 'none'] | None = None,
    variants: Literal[1] = 1,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    uniformity: float = 0.01,
    reuse: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    n: Literal[1] = 1,
    kinds: Sequence[str] | None = None,
    match: float | Sequence[float] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def stationarize(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    within: ImageLike | None = None,
    weight: ImageLike | None = None,
    sigmamap: ImageLike | None = None,
    maps: Sequence[ImageLike] = (),
    flatten: float | None = None,
    drift: bool | FileName = False,
    sigma: float | None = None,
    amount: float | None = None,
    contrast: float | None = None,
    target: Literal['flat', 'exemplar'] = 'flat',
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    structure: float = 0.5,
    preset: Literal['even', 'clean', 'keep'] | None = None,
    paper: bool = False,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tile: Literal['xy', 'x', 'y', 'none'] | None = None,
    variants: int = 1,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    uniformity: float = 0.01,
    reuse: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    n: int = 1,
    kinds: Sequence[str] | None = None,
    match: float | Sequence[float] | None = None,
    label: int | None = None,
    level: int | None = None,
    data: bool = False,
    seed: int = 0,
    stmap: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]: ...

@overload
def superpixel(
    source: Picture,
    /,
    *,
    sigma: float | None = None,
    count: int | None = None,
    finest: float | None = None,
    compactness: float = 20.0,
    iterations: int = 1000,
    runs: int = 1,
    minsize: int | None = None,
    seed: int = 0,
    keep: Literal[False] = False,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Cut an image into superpixels: small connected regions of one look.

    Fine superpixels are found by SLIC in Lab and merged into coarser ones, guided by a Gaussian stack, so that coarse
    borders are a choice of fine ones (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale
    Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016, section 3). The result is a label map: ids from 1 on,
    numbered by their first pixel in reading order, 0 where alpha is 0, and the same for any tile size or memory
    budget.

    Parameters
    ----------
    source : ImageLike
        the image
    sigma : float | None, default None
        scale of the superpixels: the nearest level; the finest when left out; a number >= 1 and <= 1000000 px
    count : int | None, default None
        how many superpixels, instead of a scale; a whole number >= 1
    finest : float | None, default None
        scale of the finest level; shorter side / 50, at least 4, when left out; a number >= 2 and <= 100000 px
    compactness : float, default 20.0
        m of SLIC: how many Lab units count as much as one sigma of distance; a number >= 0.1 and <= 100
    iterations : int, default 1000
        of SLIC, at most: it stops when no seed moves; a whole number >= 1 and <= 100000
    runs : int, default 1
        of SLIC: the best of so many by eq. 3 is taken; the paper takes 10; a whole number >= 1 and <= 1000
    minsize : int | None, default None
        smaller pieces join a neighbor; a quarter of finest^2 when left out, 25 in the paper; a whole number >= 1 px
    seed : int, default 0
        of the runs after the first, whose seeds start elsewhere; a whole number >= 0 and <= 4294967295
    keep : bool, default False
        the image stays as first part, the label map follows it
    data : bool, default False
        the channels are no colors: compare them as they are
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        photo: the photo, before all others [pixels; with keep]
        superpixels: one channel, of the image's windows: write it to EXR or TIFF [32-bit ids]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def superpixel(
    source: ImageLike,
    /,
    *,
    sigma: float | None = None,
    count: int | None = None,
    finest: float | None = None,
    compactness: float = 20.0,
    iterations: int = 1000,
    runs: int = 1,
    minsize: int | None = None,
    seed: int = 0,
    keep: Literal[True],
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def superpixel(
    source: ImageLike,
    /,
    *,
    sigma: float | None = None,
    count: int | None = None,
    finest: float | None = None,
    compactness: float = 20.0,
    iterations: int = 1000,
    runs: int = 1,
    minsize: int | None = None,
    seed: int = 0,
    keep: bool = False,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

@overload
def synth(
    exemplar: ImageLike | None = None,
    /,
    *,
    size: tuple[int, int] | None = None,
    window: str | None = None,
    tiles: str | None = None,
    level: int | None = None,
    toroidal: bool = False,
    resume: bool = False,
    stmap: FileName | Literal[False] = False,
    graph: FileName | None = None,
    lock: bool | int = False,
    correct: bool = True,
    dims: int = 16,
    side: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    paper: bool = False,
    seed: int | None = None,
    data: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    structure: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Synthesize a texture without end from one exemplar, or from a graph of exemplars at different scales.

    Without `graph` the top image is the one exemplar: a texture of any size grows from it (Lefebvre & Hoppe, Parallel
    controllable texture synthesis, 2005). A graph says of a few small exemplars how their scales relate, and any window
    of any level of detail can be had, alone and the same to the bit as in the whole (HRRG08: Han, Risser, Ramamoorthi,
    Grinspun, Multiscale Texture Synthesis, 2008). Exemplars are cut to squares of a power of two around their centers;
    one that does not tile is mirrored at its borders. Every pixel is a copy of one of an exemplar, but for the color
    offset by which exemplars that do not agree are brought together.

    Parameters
    ----------
    exemplar : ImageLike | None
        the one exemplar; none is taken where graph says them
    size : tuple[int, int] | None, default None
        of the result; the window's, or the exemplar's own, when left out; (width, height) >= 1 and <= 1073741824 px
    window : str | None, default None
        WxH+X+Y: only these pixels of the plane
    tiles : str | None, default None
        I/N: the share I, from 1 to N, of these pixels, some rows of them, for a farm
    level : int | None, default None
        octaves below a pixel as large as the root; the finest that exemplars hold; a whole number >= 0 and <= 60
    toroidal : bool, default False
        the result of that size tiles; sides are multiples of 2^level px
    resume : bool, default False
        keep finished pieces in OUT.parts until OUT is whole: a run that was killed goes on from there
    stmap : bool | FileName, default False
        1: source coordinates as parts of the result; a file name: there
    graph : FileName | None, default None
        an exemplar graph, JSON or YAML
    lock : bool | int, default False
        1: no jitter up to the root's own resolution, finer detail for it as it is; 2 and more: up to that level; True or False or a whole number >= 0 and <= 60
    correct : bool, default True
        bring exemplars that do not agree in color together (HRRG08 section 5)
    dims : int, default 16
        of projected neighborhoods; 6 are the paper's, 16 repeat less; a whole number >= 1 and <= 16
    side : Literal[16, 32, 64, 128, 256, 512, 1024], default 256
        of an exemplar's square, at most; 16 | 32 | 64 | 128 | 256 | 512 | 1024
    paper : bool, default False
        HRRG08 by the letter: dims=6, and zooms without end turn anywhere, to anything, and lose their contrast
    seed : int | None, default None
        same seed, same pixels; the graph's, or 0, when left out; a whole number >= 0 and <= 4294967295
    data : bool, default False
        the channels are no colors: compare them as they are
    report : FileName | None, default None
        measures of the result go to this file, JSON (docs/reference/report.md)
    fail : Sequence[str] | None, default None
        limits of measures, NAME>NUMBER or NAME<NUMBER, such as seam>1.3 and repeat>4: beyond one the run exits 3
    structure : float, default 0.5
        strength with which regular repeats of the photo (tiles, courses, weaves) are kept; 0: not at all. Where the photo's size would stretch them visibly, the default size is the nearest that holds complete repeats only. No effect on a photo without regular repeats; a number >= 0 and <= 1
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        a dict where more than one part was asked for
        texture: pixels copied from the exemplars, all channels, in the root's color space and type [pixels]
        st: where every pixel comes from, as `warp` reads it; with graph also the exemplar's number [32-bit float coordinates; with stmap]
        transfer: with graph: the offset that was added to each copied pixel, L, a and b of CIE Lab as R, G and B [32-bit float coordinates; with stmap]
        report: measures of the result, for machines [JSON; with report]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
@overload
def synth(
    exemplar: ImageLike | None = None,
    /,
    *,
    size: tuple[int, int] | None = None,
    window: str | None = None,
    tiles: str | None = None,
    level: int | None = None,
    toroidal: bool = False,
    resume: bool = False,
    stmap: Literal[True],
    graph: FileName | None = None,
    lock: bool | int = False,
    correct: bool = True,
    dims: int = 16,
    side: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    paper: bool = False,
    seed: int | None = None,
    data: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    structure: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> dict[str, ImageBuf]: ...
@overload
def synth(
    exemplar: ImageLike | None = None,
    /,
    *,
    size: tuple[int, int] | None = None,
    window: str | None = None,
    tiles: str | None = None,
    level: int | None = None,
    toroidal: bool = False,
    resume: bool = False,
    stmap: bool | FileName = False,
    graph: FileName | None = None,
    lock: bool | int = False,
    correct: bool = True,
    dims: int = 16,
    side: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    paper: bool = False,
    seed: int | None = None,
    data: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    structure: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf | dict[str, ImageBuf]: ...

def variants(
    exemplar: ImageLike,
    /,
    *,
    filter: Literal['stationarize', 'patchmatch', 'quilt', 'cut', 'synth', 'composite'] = 'stationarize',
    seeds: int = 4,
    seed: int = 0,
    vary: str | None = None,
    over: Sequence[str] | None = None,
    thumb: int = 256,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Lay out what a synthesis makes of a photo: a column for every seed, a row for every value of one modifier.

    So a seed is chosen by eye, or it is seen what a modifier does: `vary=sigma:over=8,16,32` makes three rows of
    `stationarize`. Everything else is as the filter has it when nothing is said. The caption says what to say for
    the one that is liked. The result is an 8-bit sRGB image for screens: do not measure it.

    Parameters
    ----------
    exemplar : ImageLike
        the photo; for composite with label maps
    filter : Literal['stationarize', 'patchmatch', 'quilt', 'cut', 'synth', 'composite'], default 'stationarize'
        the filter, by the name of its function
    seeds : int, default 4
        how many seeds, from seed on; a whole number >= 1 and <= 16
    seed : int, default 0
        the first seed; a whole number >= 0 and <= 4294967279
    vary : str | None, default None
        the modifier that differs from row to row
    over : Sequence[str] | None, default None
        its values, as they are said for the filter
    thumb : int, default 256
        longer side of a result in the sheet, at most; a whole number >= 32 and <= 2048 px
    data : bool, default False
        the channels are no colors: compare them as they are
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        view: the sheet [8-bit sRGB picture]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

def warp(
    source: ImageLike,
    st: ImageLike,
    /,
    *,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Re-make an image from a map of source coordinates, pixel for pixel, to the bit.

    Of a photo's normals and the `stmap` of a tile, it makes the normals that belong to that tile. The result has the
    map's size; nothing is interpolated, so normals stay normals. The image must have the display window of the photo
    from which the map was made.

    Parameters
    ----------
    source : ImageLike
        the image to take pixels from
    st : ImageLike
        source coordinates: part 'st', else the first part
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        warped: the image's pixels at the map's places [pixels]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """

def zoom(
    exemplar: ImageLike | None = None,
    /,
    *,
    frame: int | None = None,
    first: int = 1,
    speed: float = 0.05,
    level: float | None = None,
    at: float | Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    movie: FileName | None = None,
    count: int = 48,
    rate: float = 24.0,
    graph: FileName | None = None,
    lock: bool | int = False,
    correct: bool = True,
    dims: int = 16,
    side: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    paper: bool = False,
    seed: int | None = None,
    data: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
) -> ImageBuf:
    """Make one frame of a zoom into a texture without end.

    A frame follows from its number alone, whichever others are rendered, and only what it shows is synthesized (HRRG08:
    Han, Risser, Ramamoorthi, Grinspun, Multiscale Texture Synthesis, 2008, figure 3). `--frames` says the number; on
    whole octaves a frame is a window of `synth` of that level, between them the two levels around it are resampled
    and blended. Without `graph` the top image is zoomed into for ever: one exemplar with an edge of r=1 to itself.

    Parameters
    ----------
    exemplar : ImageLike | None
        the one exemplar; none is taken where graph says them
    frame : int | None, default None
        the frame's number; that of --frames, or first, when left out
    first : int, default 1
        the number of the frame where the zoom begins
    speed : float, default 0.05
        octaves a frame: 1 doubles the size of things, below 0 zooms out; a number >= -8 and <= 8
    level : float | None, default None
        the zoom of the first frame, as of `synth`; the root's own resolution; a number >= 0 and <= 60
    at : float | Sequence[float] | None, default None
        X,Y: what is zoomed into, in pixels of the root; its middle; a number or a sequence of them px
    size : tuple[int, int] | None, default None
        of the frame; the root's own when left out; (width, height) >= 1 and <= 65536 px
    movie : FileName | None, default None
        a movie to look at goes to this file: .gif by Pillow, .mp4 by ffmpeg where it is in $PATH
    count : int, default 48
        frames of the movie, from this one on; a whole number >= 2 and <= 65536
    rate : float, default 24.0
        frames of the movie in a second; a number >= 0.1 and <= 240
    graph : FileName | None, default None
        an exemplar graph, JSON or YAML
    lock : bool | int, default False
        1: no jitter up to the root's own resolution, finer detail for it as it is; 2 and more: up to that level; True or False or a whole number >= 0 and <= 60
    correct : bool, default True
        bring exemplars that do not agree in color together (HRRG08 section 5)
    dims : int, default 16
        of projected neighborhoods; 6 are the paper's, 16 repeat less; a whole number >= 1 and <= 16
    side : Literal[16, 32, 64, 128, 256, 512, 1024], default 256
        of an exemplar's square, at most; 16 | 32 | 64 | 128 | 256 | 512 | 1024
    paper : bool, default False
        HRRG08 by the letter: dims=6, and zooms without end turn anywhere, to anything, and lose their contrast
    seed : int | None, default None
        same seed, same pixels; the graph's, or 0, when left out; a whole number >= 0 and <= 4294967295
    data : bool, default False
        the channels are no colors: compare them as they are
    report : FileName | None, default None
        measures of the result go to this file, JSON (docs/reference/report.md)
    fail : Sequence[str] | None, default None
        limits of measures, NAME>NUMBER or NAME<NUMBER, such as seam>1.3 and repeat>4: beyond one the run exits 3
    colorspace : str | None, default None
        color space of the images that come first; their own tag where it is None
    roi : ROI | None, default None
        compute only this region of the result
    nthreads : int, default 0
        CPU threads, where no session says it; 0: as many as the process may use
    session : Session | None, default None
        device, memory budget, color config, progress

    Returns
    -------
    ImageBuf
        frame: all channels, in the root's color space and type; its display window begins at 0 [pixels]
        movie: the zoom from this frame on, in sRGB [GIF or MP4; with movie]
        report: measures of the result, for machines [JSON; with report]

    Raises
    ------
    oiiotex.Error
        with one line that says what is wrong and what is allowed
    """
