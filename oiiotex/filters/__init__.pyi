# SPDX-License-Identifier: Apache-2.0
# Made by `python -m tools.docs.stubs` from the declarations: change those.
"""The filters as functions."""

from collections.abc import Sequence
from typing import Any, Literal, overload

from OpenImageIO import ROI, ImageBuf

from ..core.op import Op
from ..deferred import Shelf
from ..python_types import Array, FileName, ImageLike, Picture
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
    obj: FileName | None = None,
    normals: Literal['opengl', 'directx'] = 'opengl',
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Create a texture for a mesh, continuous across the borders of its UV charts.

    It can cover a mesh with the dominant texture of a photo, as in LDR09 figure 7 (Lu, Dorsey, Rushmeier, Dominant
    Texture and Diffusion Distance Manifolds, 2009). A mask from `dominant` keeps objects and stains of the photo off
    the mesh. Pixels of the charts are synthesized from coarse to fine (Lefebvre & Hoppe, Appearance-space texture
    synthesis, SIGGRAPH 2006, section 5), each from its neighbors on the surface, which are rotated and scaled across
    shared edges.

    The texture is oriented along the u axis of the charts, smoothed over the surface. The texture has the same scale
    everywhere, regardless of the scale of each chart. All maps of a material are synthesized together
    (kinds=color,data,normal), and tangent-space normals rotate with the texture. Gutters of 8 px continue the
    texture beyond the border of each chart. A mesh without UVs is unwrapped by xatlas: render the result on the mesh
    that obj=FILE.obj writes. Requires `pip install oiiotex[atlas]`.

    Parameters
    ----------
    exemplar : ImageLike
        Photo; of the maps of a material, the first.
    mask : ImageLike | None, default None
        Image that marks the valid source pixels (first channel above half its range, or a nonzero label
        id). A string is the name of a part of the first image, or a file name.
    maps : Sequence[ImageLike], default ()
        Further maps, resynthesized from the same source pixels. A string is the name of a part of the
        first image, or a file name.
    mesh : FileName | None, default None
        Mesh to texture: OBJ, PLY, glTF, GLB, STL or OFF. UVs must lie within 0 to 1 without overlaps; a
        mesh without UVs is unwrapped. Default: none; a mesh is required.
    size : tuple[int, int] | None, default None
        Size of the result; with udim, of a tile. Expected: (width, height) from 16 to 16384 px.
        Default: the exemplar's size.
    udim : tuple[int, int] | None, default None
        Columns x rows of the UDIM tiles of the mesh, starting at 1001. The result contains all tiles;
        -o:udim=3x2 "albedo.<UDIM>.exr" writes a file for each. Expected: (width, height) from 1 to 10.
    scale : float | None, default None
        Width of the photo on the surface, in units of the mesh. Expected: a number >= 1e-09. Default: a
        pixel of the photo is a pixel of the atlas.
    obj : FileName | None, default None
        File (.obj) for the mesh with the UV charts of the result.
    kinds : Sequence[str] | None, default None
        Kind of each map of a material: color, data, normal or height. The last images on the stack are
        used, one for each kind, in order. Maps other than color are tagged as data in the result.
        Default: one map: color; with data=1, data.
    label : int | None, default None
        Id of a label in the exemplar's label maps. Only pixels of that label are used as a source.
        Expected: an integer >= 1.
    seed : int, default 0
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]
        A dict of parts by name if more than one part is requested.
        A list of these if several images are made.
        - atlas: Atlas of pixels copied from the photo, one for each map. Normals are rotated. [pixels]
        - st: Source coordinates of every pixel, for `warp` and `st_warp`. [32-bit float coordinates;
          with st]
        - obj: Mesh with the UV charts of the atlas. [.obj; with obj]

    Other Parameters
    ----------------
    labels : ImageLike | None, default None
        Label maps of the exemplar, if they are not stored as its parts. A string is the name of a part
        of the first image, or a file name.
    normals : Literal['opengl', 'directx'], default 'opengl'
        Green channel of normal maps. opengl: up; directx: down.
    mapweights : float | Sequence[float] | None, default None
        Weight of each map in the comparison of patches, in order. 0: the map is not compared, but
        follows the others. Expected: a number or a sequence of numbers >= 0. Default: 1 for each map,
        0.25 for a height.
    labellevel : int | None, default None
        Level of the label maps: N selects the part label.N. 1 is the finest. Expected: an integer >= 1.
        Default: the coarsest with several labels.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that
        file.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> atlas = filters.atlas("photo.png", mesh="statue.obj", size=(1024, 1024))
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
    obj: FileName | None = None,
    normals: Literal['opengl', 'directx'] = 'opengl',
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
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
    obj: FileName | None = None,
    normals: Literal['opengl', 'directx'] = 'opengl',
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]: ...
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
    obj: FileName | None = None,
    normals: Literal['opengl', 'directx'] = 'opengl',
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def checkmaterial(
    source: ImageLike,
    /,
    *,
    kinds: Sequence[str] | None = None,
    normals: Literal['opengl', 'directx'] = 'opengl',
    failon: Literal['errors', 'warnings', 'none'] = 'errors',
    facts: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Check the maps of a material for problems in rendering, and pass them on unchanged.

    All maps: different sizes, NaN and Inf, a color space that conflicts with the kind of the map.
    Albedo: values that no real surface has, and baked lighting: low-frequency variation of lightness, or lightness
    that correlates with the normals (directional light) or with the heights (occlusion).
    Normals: vectors that are not of unit length or point down, a tilted mean, and a green channel of the wrong sign
    (OpenGL up, DirectX down). The sign is tested against the heights, or without heights by the curl of the slopes.
    Heights: a constant map, and 8-bit files. Other data: values outside of 0 to 1.

    Each finding is printed as a line; facts= writes them to a file with all measures. Errors render incorrectly,
    warnings possibly. The run always completes; with fail=errors its exit code is 3 if there is an error.

    Parameters
    ----------
    source : ImageLike
        Map to check; of the maps of a material, the first.
    maps : Sequence[ImageLike], default ()
        Other maps of the material. A string is the name of a part of the first image, or a file name.
    kinds : Sequence[str] | None, default None
        Kind of each map of a material: color, data, normal or height. The last images on the stack are
        used, one for each kind, in order. Maps other than color are tagged as data in the result.
        Default: one map: color.
    normals : Literal['opengl', 'directx'], default 'opengl'
        Expected green channel of normals. opengl: up; directx: down.
    failon : Literal['errors', 'warnings', 'none'], default 'errors'
        Findings that set the exit code to 3. errors: errors only; warnings: both; none: neither.
    facts : FileName | None, default None
        File for findings and measures.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | list[ImageBuf] | list[dict[str, ImageBuf]]
        A dict of parts by name if more than one part is requested.
        A list of these if several images are made.
        - map: Maps, unchanged. [pixels]
        - facts: Findings, and measures of each map. [JSON; with facts]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> maps = ["roughness.png"]
    >>> same = filters.checkmaterial("photo.png", maps=maps, kinds=["color", "data"], facts="checks.json")
    """
@overload
def checkmaterial(
    source: ImageLike,
    /,
    *,
    maps: Sequence[ImageLike] = (),
    kinds: Sequence[str] | None = None,
    normals: Literal['opengl', 'directx'] = 'opengl',
    failon: Literal['errors', 'warnings', 'none'] = 'errors',
    facts: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | list[ImageBuf] | list[dict[str, ImageBuf]]: ...
@overload
def checkmaterial(
    source: ImageLike,
    /,
    *,
    maps: Sequence[ImageLike] = (),
    kinds: Sequence[str] | None = None,
    normals: Literal['opengl', 'directx'] = 'opengl',
    failon: Literal['errors', 'warnings', 'none'] = 'errors',
    facts: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def composite(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    restarts: int = 4,
    planfile: FileName | None = None,
    grown: Literal[False] = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: Literal[False] = False,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Create a texture of any size that varies as the photo does.

    Use it for a larger area with the same mix of textures as the photo, such as moss on stone. A new label map is
    grown with the proportions and neighborhoods of the map from `label`, and filled with texture from the photo (as
    by `quilt` with the grown map as its guide). Each pixel of the result is a copy of one pixel of the photo.

    Section 7 of LSA16 suggests this (Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale
    Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016).

    Parameters
    ----------
    exemplar : ImageLike
        Photo. Where labels are used, with the label maps that `label` with `photo` creates.
    mask : ImageLike | None, default None
        Image that marks the valid source pixels (first channel above half its range, or a nonzero label
        id). A string is the name of a part of the first image, or a file name.
    size : tuple[int, int] | None, default None
        Size of the result. Expected: (width, height) from 8 to 4194304 px. Default: twice the
        exemplar's size.
    planfile : FileName | None, default None
        File (.npz) for the plan, which `quilt` renders with `fromplan`.
    grown : bool, default False
        Append the grown label map as part 'grown'.
    tiles : Literal['none', 'x', 'y', 'xy'], default 'none'
        Axes along which the result tiles.
    patch : int | None, default None
        Side of a patch. Increase it to preserve larger structures, decrease it for more variation.
        Expected: an integer from 8 to 256 px. Default: the labels' scale or, without labels, shorter
        side / 8, as a power of two; less if a label is rare.
    guideweight : float, default 1.0
        Weight of the guide's labels inside a patch, compared with color. Increase it to follow the
        guide more closely. Expected: a number from 0 to 100.
    labelmaps : bool, default False
        Append the label maps of the result as parts label.N, rearranged exactly as its pixels.
    seed : int, default 0
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - composite: Pixels copied from the photo, all channels together, in its color space and type.
          [pixels]
        - st: Source coordinates of every pixel, for `warp` and `st_warp`. [32-bit float coordinates;
          with st]
        - label.N: Label parts of the photo, copied from the same source pixels. [32-bit ids; with
          labelmaps]
        - planfile: Offsets and cuts. [.npz; with planfile]
        - grown: Grown label map, a guide for `quilt` and `paint`. [32-bit ids; with grown]
        - report: Measures of the result, for programs. [JSON; with report]

    Other Parameters
    ----------------
    labels : ImageLike | None, default None
        Label maps of the exemplar, if they are not stored as its parts. A string is the name of a part
        of the first image, or a file name.
    restarts : int, default 4
        Number of label maps to grow. The one closest to the original is used. Expected: an integer from
        1 to 64.
    report : FileName | None, default None
        JSON file for the measures of the result (see docs/reference/report.md).
    fail : Sequence[str] | None, default None
        Conditions that count as failure, such as fidelity<0.8,seam>1.5. If one is true, the result is
        still written, but the exit code is 3.
    candidates : int, default 256
        Maximum number of candidate patches per place. Expected: an integer from 1 to 65536.
    freeuses : float, default 1.0
        Number of times that a region of the exemplar may be copied before further copies are penalized,
        relative to equal use of all regions. Two copies are always free. Reduce it if regions repeat,
        increase it if patches match poorly. Expected: a number from 0 to 1000000000.
    finerweight : float, default 0.5
        Weight of finer levels' labels in the overlaps, compared with color. Expected: a number from 0
        to 100.
    labellevel : int | None, default None
        Level of the label maps: N selects the part label.N. 1 is the finest. Expected: an integer >= 1.
        Default: the coarsest with several labels.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that
        file.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> photo = filters.label("photo.png", photo=True)
    >>> texture = filters.composite(photo, size=(1024, 512))
    """
@overload
def composite(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    restarts: int = 4,
    planfile: FileName | None = None,
    grown: Literal[True],
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: bool = False,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def composite(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    restarts: int = 4,
    planfile: FileName | None = None,
    grown: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: bool = False,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def composite(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    restarts: int = 4,
    planfile: FileName | None = None,
    grown: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: bool = False,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def composite(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    restarts: int = 4,
    planfile: FileName | None = None,
    grown: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: bool = False,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def content(
    source: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    center: float | Sequence[float] | None = None,
    labellevel: int | None = None,
    patch: int | None = None,
    keys: bool = False,
    facts: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Show where an image has the same content as a given patch, or draw a table of all contents.

    The two most frequent labels in a square patch are its key, by which `quilt` selects patches (LSA16: Lockerman,
    Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH
    2016, section 6.1). Use this to see why a guide selects certain patches. The patch at `center` is outlined on the
    photo, and the centers of all patches with the same key are marked red (figure 10). The label histograms of the
    patch at each level are printed (figure 9); facts= writes them to a file. With `keys`, a table shows a patch for
    each key: rows are the first label, columns the second (figure 11). The result is an 8-bit sRGB image for
    display, not for measurement.

    Parameters
    ----------
    source : ImageLike
        Image with label parts, from `label` with `photo`.
    labels : ImageLike | None, default None
        Label maps of the exemplar, if they are not stored as its parts. A string is the name of a part
        of the first image, or a file name.
    center : float | Sequence[float] | None, default None
        Center X,Y of the patch, in the data window. Expected: a number or a sequence of numbers in px.
        Default: the center of the image.
    labellevel : int | None, default None
        Level of the label map: N of label.N. Expected: an integer >= 1. Default: the coarsest with
        several labels.
    patch : int | None, default None
        Side of a patch. Expected: an integer from 4 to 256 px. Default: the power of two nearest to the
        level's scale, from 16 to 256.
    keys : bool, default False
        Draw the table of keys instead.
    facts : FileName | None, default None
        File for the key, histograms and the number of patches of each key.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - view: Photo with similar patches marked, or the table of keys. [8-bit sRGB picture]
        - facts: Key, histograms at each level, number of patches of each key. [JSON; with facts]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> labeled = filters.label("photo.png", photo=True)
    >>> same = filters.content(labeled, center=(20, 30))
    """
@overload
def content(
    source: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    center: float | Sequence[float] | None = None,
    labellevel: int | None = None,
    patch: int | None = None,
    keys: bool = False,
    facts: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
def cut(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    patch: int | None = None,
    passes: int = 1,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: FileName | Literal[False] = False,
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Synthesize a texture from large patches of a photo, joined along minimum-error seams (graph cuts).

    Graph-cut textures (KSE03: Kwatra, Schoedl, Essa, Turk, Bobick, Graphcut Textures, SIGGRAPH 2003): matching patches
    are placed one after another, and each is cut against the existing texture along the cheapest seam of any shape.
    A visible seam is covered by a further patch. With label=3, only pixels of label 3 are used (LSA16:
    Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis,
    SIGGRAPH 2016, section 5.2). Each pixel of the result is a copy of one pixel of the photo.

    Parameters
    ----------
    exemplar : ImageLike
        Photo. Where labels are used, with the label maps that `label` with `photo` creates.
    mask : ImageLike | None, default None
        Image that marks the valid source pixels (first channel above half its range, or a nonzero label
        id). A string is the name of a part of the first image, or a file name.
    size : tuple[int, int] | None, default None
        Size of the result. Expected: (width, height) from 5 to 16384 px. Default: the exemplar's size.
    tiles : Literal['none', 'x', 'y', 'xy'], default 'xy'
        Axes along which the result tiles.
    patch : int | None, default None
        Side of a patch. Increase it to preserve larger structures. Expected: an integer from 5 to 512
        px. Default: shorter side of the exemplar / 5, at least 16 and at most 96.
    passes : int, default 1
        Number of refinement passes. Each pass adds as many patches as the first fill, over the most
        visible seams. Increase it if seams are visible. Expected: an integer from 0 to 100.
    label : int | None, default None
        Id of a label in the exemplar's label maps. Only pixels of that label are used as a source.
        Expected: an integer >= 1.
    seed : int, default 0
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295.
    lattice : float, default 0.5
        Strength with which regular repeats (tiles, courses, weaves) are preserved. If the photo's size
        does not hold complete repeats, the result gets the nearest size that does, unless size is set.
        0: repeats are not preserved. No effect on photos without regular repeats. Expected: a number
        from 0 to 1.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - cut: Pixels copied from the photo, all channels together, in its color space and type.
          [pixels]
        - st: Source coordinates of every pixel, for `warp` and `st_warp`. [32-bit float coordinates;
          with st]
        - report: Measures of the result, for programs. [JSON; with report]

    Other Parameters
    ----------------
    labels : ImageLike | None, default None
        Label maps of the exemplar, if they are not stored as its parts. A string is the name of a part
        of the first image, or a file name.
    report : FileName | None, default None
        JSON file for the measures of the result (see docs/reference/report.md).
    fail : Sequence[str] | None, default None
        Conditions that count as failure, such as fidelity<0.8,seam>1.5. If one is true, the result is
        still written, but the exit code is 3.
    labellevel : int | None, default None
        Level of the label maps: N selects the part label.N. 1 is the finest. Expected: an integer >= 1.
        Default: the coarsest with several labels.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that
        file.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> photo = filters.label("photo.png", photo=True)
    >>> tile = filters.cut(photo, label=1)
    """
@overload
def cut(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    patch: int | None = None,
    passes: int = 1,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: Literal[True],
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def cut(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    patch: int | None = None,
    passes: int = 1,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def cut(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    size: tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    patch: int | None = None,
    passes: int = 1,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def decompose(
    source: Picture,
    /,
    *,
    maxlabels: int | None = None,
    group: Literal['merging', 'cliques'] | None = None,
    threshold: float | None = None,
    radius: float | None = None,
    shift: float | None = None,
    features: Literal['bank', 'haar'] = 'bank',
    textons: int | None = None,
    step: int | None = None,
    scales: int = 1,
    search: Literal['grid', 'meanshift'] = 'grid',
    refine: bool = True,
    assign: Literal['competition', 'neighbors'] = 'competition',
    invariant: bool = False,
    paper: bool = False,
    photo: Literal[False] = False,
    cryptomatte: Literal[False] = False,
    palette: FileName | None = None,
    onepart: bool = False,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Segment a texture into the simpler textures that it consists of.

    Use it for mixed photos, such as grass and gravel: it gives few large regions, where `label` gives labels at
    several scales. Regions compete for pixels by their textons (clusters of local features). Pairs of regions that
    are probably one texture are merged until no such pair is left; with `maxlabels`, until that number of regions is
    left. The remaining subtextures then compete once more. The result is a label map with ids from 1, and 0 where
    alpha is 0. Images above a megapixel are analyzed at an integer fraction of their resolution.

    For comparison, group=cliques compares the texton histograms of sampled places, searches near each place for the
    best match, and groups the places by clique partitioning (CZF02: Caenen, Zalesny, Ferrari, Van Gool,
    Unsupervised Texture Segmentation by Clique Partitioning).

    Parameters
    ----------
    source : ImageLike
        Image to segment.
    maxlabels : int | None, default None
        Maximum number of subtextures. Expected: an integer from 1 to 50. Default: chosen by the filter.
    threshold : float | None, default None
        Probability, or with group=cliques similarity, above which regions become one texture. Increase
        it for more subtextures. Not used if `maxlabels` is set. Expected: a number from 0 to 1.
        Default: 0.32; with group=cliques, 0.76; with features=haar, 0.95.
    radius : float | None, default None
        Radius of the area that is compared as one sample of texture. Increase it for coarse textures.
        Expected: a number from 1 to 512 px. Default: 48; with features=haar, 8.
    invariant : bool, default False
        Regard rotated versions of a texture as one texture, and those of a slightly different scale. No
        effect with features=haar.
    paper : bool, default False
        Settings of the paper (CZF02):
        features=haar:group=cliques:scales=3:search=meanshift:refine=0:assign=neighbors.
    photo : bool, default False
        Keep the photo as the first part, before the labels.
    cryptomatte : bool | FileName, default False
        Append Cryptomatte 1.2 as a part. A file name: also write the manifest to that file.
    palette : FileName | None, default None
        Table from `palette`, whose names are written to label parts and Cryptomatte.
    facts : FileName | None, default None
        File for the number and areas of subtextures.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - photo: Photo, as the first part. [pixels; with photo]
        - label.1: Label map: one channel in the image's windows. Write it to EXR or TIFF. [32-bit ids]
        - cryptomatte: Labels as Cryptomatte. [Cryptomatte 1.2; with cryptomatte]
        - facts: Number and areas of subtextures, and settings. [JSON; with facts]

    Other Parameters
    ----------------
    group : Literal['merging', 'cliques'] | None, default None
        Grouping method. merging: of regions, recommended. cliques: of places that are compared in pairs
        (CZF02). Default: merging; with features=haar, cliques.
    shift : float | None, default None
        Search radius for the best match of a place, with group=cliques. 0: no search. Expected: a
        number from 0 to 512 px. Default: 24; with features=haar, the radius.
    features : Literal['bank', 'haar'], default 'bank'
        Features of the textons. bank: filter bank, recommended. haar: color and Haar wavelets, as in
        the paper. haar changes the defaults of other modifiers.
    textons : int | None, default None
        Number of textons; with features=haar, of each kind (color and detail). Increase it to separate
        similar textures. Expected: an integer from 2 to 64. Default: 64; with features=haar, 8.
    step : int | None, default None
        Spacing of the places that are compared, with group=cliques. Expected: an integer from 1 to 512
        px. Default: derived from the size of the image.
    scales : int, default 1
        Number of sizes, half an octave apart, at which each place is compared with others, with
        group=cliques. Expected: an integer from 1 to 5.
    search : Literal['grid', 'meanshift'], default 'grid'
        Search method for the best match, with group=cliques. meanshift: as in the paper, slow.
    refine : bool, default True
        Refinement of the cliques, which moves single places between them. The paper has none.
    assign : Literal['competition', 'neighbors'], default 'competition'
        Assignment of pixels to subtextures. competition: by textons; neighbors: by places, as in the
        paper.
    onepart : bool, default False
        Output as one unnamed part with the channels of the image and of Cryptomatte, as Blender and
        Nuke expect. Requires cryptomatte.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> ids = filters.decompose("photo.png")
    >>> view = filters.labelview(ids)
    """
@overload
def decompose(
    source: ImageLike,
    /,
    *,
    maxlabels: int | None = None,
    group: Literal['merging', 'cliques'] | None = None,
    threshold: float | None = None,
    radius: float | None = None,
    shift: float | None = None,
    features: Literal['bank', 'haar'] = 'bank',
    textons: int | None = None,
    step: int | None = None,
    scales: int = 1,
    search: Literal['grid', 'meanshift'] = 'grid',
    refine: bool = True,
    assign: Literal['competition', 'neighbors'] = 'competition',
    invariant: bool = False,
    paper: bool = False,
    photo: Literal[True],
    cryptomatte: bool | FileName = False,
    palette: FileName | None = None,
    onepart: bool = False,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def decompose(
    source: ImageLike,
    /,
    *,
    maxlabels: int | None = None,
    group: Literal['merging', 'cliques'] | None = None,
    threshold: float | None = None,
    radius: float | None = None,
    shift: float | None = None,
    features: Literal['bank', 'haar'] = 'bank',
    textons: int | None = None,
    step: int | None = None,
    scales: int = 1,
    search: Literal['grid', 'meanshift'] = 'grid',
    refine: bool = True,
    assign: Literal['competition', 'neighbors'] = 'competition',
    invariant: bool = False,
    paper: bool = False,
    photo: bool = False,
    cryptomatte: Literal[True],
    palette: FileName | None = None,
    onepart: bool = False,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def decompose(
    source: ImageLike,
    /,
    *,
    maxlabels: int | None = None,
    group: Literal['merging', 'cliques'] | None = None,
    threshold: float | None = None,
    radius: float | None = None,
    shift: float | None = None,
    features: Literal['bank', 'haar'] = 'bank',
    textons: int | None = None,
    step: int | None = None,
    scales: int = 1,
    search: Literal['grid', 'meanshift'] = 'grid',
    refine: bool = True,
    assign: Literal['competition', 'neighbors'] = 'competition',
    invariant: bool = False,
    paper: bool = False,
    photo: bool = False,
    cryptomatte: bool | FileName = False,
    palette: FileName | None = None,
    onepart: bool = False,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def decompose(
    source: ImageLike,
    /,
    *,
    maxlabels: int | None = None,
    group: Literal['merging', 'cliques'] | None = None,
    threshold: float | None = None,
    radius: float | None = None,
    shift: float | None = None,
    features: Literal['bank', 'haar'] = 'bank',
    textons: int | None = None,
    step: int | None = None,
    scales: int = 1,
    search: Literal['grid', 'meanshift'] = 'grid',
    refine: bool = True,
    assign: Literal['competition', 'neighbors'] = 'competition',
    invariant: bool = False,
    paper: bool = False,
    photo: bool = False,
    cryptomatte: bool | FileName = False,
    palette: FileName | None = None,
    onepart: bool = False,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

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
    photo: Literal[False] = False,
    types: Literal[False] = False,
    score: Literal[False] = False,
    facts: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Find the dominant texture of a photo: a mask without objects, cracks, stains and shadows.

    Patches are grouped by similarity, starting from the most typical one: heat diffuses from it through the large
    group of similar patches, but hardly to others (LDR09: Lu, Dorsey, Rushmeier, Dominant Texture and Diffusion
    Distance Manifolds, Eurographics 2009). The mask is 1 in dominant patches, else 0. If no group contains 40 % of
    the patches, the mask is empty and a warning is printed; with `strict`, the run stops with an error. With `photo`
    the photo is the first part and the mask follows it as part 'dominant', which can guide a synthesis.

    Attributes record the patch side in px (oiiotex:patch), the size of the kernel (oiiotex:epsilon), the dimension of
    the manifold (oiiotex:dimension), the diffusion steps (oiiotex:tau) and the fraction of dominant patches
    (oiiotex:share).

    Parameters
    ----------
    source : ImageLike
        Photo to mask.
    mask : ImageLike | None, default None
        Region to analyze. Pixels outside of it are ignored. A string is the name of a part of the first
        image, or a file name.
    patch : int | None, default None
        Side of a patch, rounded to an odd number. Increase it if the texture has large elements.
        Expected: an integer from 3 to 63 px. Default: estimated from the photo's Fourier transform.
    step : int | None, default None
        Spacing of patches. Expected: an integer from 1 to 256 px. Default: the smallest that gives at
        most 12000 patches.
    mode : Literal['diffusion', 'euclidean', 'spectral'], default 'diffusion'
        Method that finds similar patches. diffusion: heat diffusion, recommended. euclidean (colors,
        LDR09 eq. 7) and spectral (the larger half of a normalized cut) are for comparison.
    paper : bool, default False
        Settings of the paper (LDR09): rule=paper:mode=diffusion:step=1, without an estimate of noise.
    strict : bool, default False
        Error instead of a warning for a photo without a dominant texture.
    photo : bool, default False
        Keep the photo as the first part, before the mask.
    facts : FileName | None, default None
        JSON file with diagnostics: the curve by which the kernel size was chosen, thresholds and
        iterations.
    chart : FileName | None, default None
        Image file with diagnostic plots: the curve by which the kernel size was chosen, and density
        against heat.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - photo: Photo, as the first part. [pixels; with photo]
        - dominant: Mask: 1 in the dominant texture, in the image's windows. [0 or 1, 32-bit floats]
        - types: Type of the patch around each pixel (LDR09 section 4): 1 to 4 for types 0, I, II and
          III. [32-bit ids; with types]
        - score: Density, and the decimal logarithm of heat. [32-bit float values; with score]
        - facts: Kernel curve, thresholds, iterations and proportions. [JSON; with facts]
        - chart: Plots of the kernel curve, and of density against heat. [8-bit sRGB picture; with
          chart]

    Other Parameters
    ----------------
    rule : Literal['repaired', 'paper'], default 'repaired'
        Rules for thresholds and mask. repaired: those of the paper, corrected; paper: those of the
        paper, as published.
    types : bool, default False
        Append part 'types', the type of the patch around each pixel (LDR09 section 4): 1 dominant, 2
        small group, 3 bridge between groups, 4 scattered, 0 no patch.
    score : bool, default False
        Append part 'score' with two channels: density, and the decimal logarithm of heat. Both are high
        in the dominant texture.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> mask = filters.dominant("photo.png")
    >>> tile = filters.stationarize("photo.png", mask=mask)
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
    photo: Literal[True],
    types: bool = False,
    score: bool = False,
    facts: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
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
    photo: bool = False,
    types: Literal[True],
    score: bool = False,
    facts: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
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
    photo: bool = False,
    types: bool = False,
    score: Literal[True],
    facts: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
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
    photo: bool = False,
    types: bool = False,
    score: bool = False,
    facts: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
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
    photo: bool = False,
    types: bool = False,
    score: bool = False,
    facts: FileName | None = None,
    chart: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def estimateao(
    source: ImageLike,
    /,
    *,
    radius: int = 32,
    relief: float | None = None,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Compute ambient occlusion from a height map.

    1 is unoccluded, 0 is fully occluded. In each of sixteen directions the steepest horizon within the radius is
    found, and the light between the horizons is integrated in closed form (Jimenez and others 2016, eq. 10). Results
    agree with ray tracing of the same heights to 0.01. The scale of the heights is a guess unless `relief` or the
    attribute oiiotex:heightpx gives it. Occlusion from farther away than the radius is ignored.

    Parameters
    ----------
    source : ImageLike
        Height map: its first channel, where larger is nearer.
    radius : int, default 32
        Maximum distance at which the surface occludes. Expected: an integer from 2 to 1024 px.
    relief : float | None, default None
        Height that a value of 1 stands for. Expected: a number from 1e-06 to 1000000 px. Default: the
        attribute oiiotex:heightpx, else longer side / 32.
    tiled : Literal['none', 'x', 'y', 'xy'], default 'none'
        Axes along which the heights tile.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - ao: Ambient occlusion: one channel, 0 (fully occluded) to 1 (unoccluded). [32-bit float
          values]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> height = filters.estimateheight("photo.png")
    >>> occlusion = filters.estimateao(height)
    """
@overload
def estimateao(
    source: ImageLike,
    /,
    *,
    radius: int = 32,
    relief: float | None = None,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
def estimateheight(
    source: ImageLike,
    /,
    *,
    normal: FileName | Literal[False] = False,
    light: float | None = None,
    overcast: bool = False,
    elevation: float = 45.0,
    negate: bool = False,
    sigma: float | None = None,
    strength: float = 1.0,
    normals: Literal['opengl', 'directx'] = 'opengl',
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Estimate heights and normals of a material from the shading of one photo.

    The surface is assumed to be matte, of uniform color apart from structures larger than sigma, and lit from one side
    (Pentland 1990) or by an overcast sky, where recesses are dark (Langer and Zucker 1994). Heights are the integrable
    surface closest to the estimated slopes (Frankot and Chellappa 1988, by FFT). Paint is mistaken for relief. If a
    scan has a height map, use that instead.

    A photo cannot tell from which of two opposite sides the light comes. Light from above is assumed, or from the left
    if it comes from the side. If raised and recessed parts are swapped in the result, set `light` to the other side, or
    `negate`. Two materials or paints of different lightness, such as stones and bright mortar, are refused without
    `light` or `overcast`: their depth cannot be seen. Dark joints are accepted.

    Heights are stored as 0 to 1; the attribute oiiotex:heightpx contains the height, in pixels, of the value 1.

    Parameters
    ----------
    source : ImageLike
        Photo to analyze.
    normal : bool | FileName, default False
        Normal map. 1: append it as part 'normal'; a file name: write it to that file.
    light : float | None, default None
        Direction of the light, counterclockwise from the right: 90 is above. Without it, light without
        a clear direction is taken as overcast. Expected: a number from -360 to 360 degrees. Default:
        from the shading.
    overcast : bool, default False
        Overcast light, without a direction: dark is deep.
    elevation : float, default 45.0
        Elevation of the light above the surface. Lower values give flatter relief. Expected: a number
        from 1 to 89 degrees.
    negate : bool, default False
        Swap raised and recessed parts. For overcast light, this means that bright is deep.
    sigma : float | None, default None
        Scale above which variation is taken as color or uneven light, not relief. Expected: a number
        from 1 to 1000000 px. Default: longer side / 8.
    strength : float, default 1.0
        Multiplier of the slopes in the normal map. Expected: a number from 0.01 to 100.
    normals : Literal['opengl', 'directx'], default 'opengl'
        Green channel of the normals. opengl: up; directx: down.
    tiled : Literal['none', 'x', 'y', 'xy'], default 'none'
        Axes along which the photo tiles.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - height: Height map: one channel, 0 to 1, higher values are closer to the viewer. [32-bit float
          values]
        - normal: Normal map of these heights, encoded as 0 to 1. [32-bit float values; with normal]

    Other Parameters
    ----------------
    data : bool, default False
        Treat the first channel as luminance, not color.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> maps = filters.estimateheight("photo.png", normal=True)
    >>> list(maps)
    ['height', 'normal']
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
    negate: bool = False,
    sigma: float | None = None,
    strength: float = 1.0,
    normals: Literal['opengl', 'directx'] = 'opengl',
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
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
    negate: bool = False,
    sigma: float | None = None,
    strength: float = 1.0,
    normals: Literal['opengl', 'directx'] = 'opengl',
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def estimateheight(
    source: ImageLike,
    /,
    *,
    normal: bool | FileName = False,
    light: float | None = None,
    overcast: bool = False,
    elevation: float = 45.0,
    negate: bool = False,
    sigma: float | None = None,
    strength: float = 1.0,
    normals: Literal['opengl', 'directx'] = 'opengl',
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def estimateroughness(
    source: ImageLike,
    /,
    *,
    sigma: float | None = None,
    middle: float = 0.6,
    spread: float = 0.3,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Estimate the roughness of a material from the local contrast of one photo.

    Where a bumpy surface is smooth, it glitters: highlights lie next to dark reflections. The contrast of the
    finest detail is measured in linear light over a Gaussian of sigma. Places with more contrast than the whole
    photo become smoother than `middle`, places with less become rougher, by at most `spread`. The estimate is weak
    (its page has figures): fine paint appears smooth, and a photo under an overcast sky contains almost no
    information. If a scan has a roughness map, use that instead. Memory does not grow with the photo.

    Parameters
    ----------
    source : ImageLike
        Photo to analyze.
    sigma : float | None, default None
        Scale of the local contrast. Expected: a number from 1 to 1000000 px. Default: longer side / 16,
        at least 2.
    middle : float, default 0.6
        Roughness where the local contrast is average. Expected: a number from 0 to 1.
    spread : float, default 0.3
        Maximum deviation from middle. Expected: a number from 0 to 1.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - roughness: Roughness map: one channel, 0 (mirror) to 1 (matte). [32-bit float values]

    Other Parameters
    ----------------
    data : bool, default False
        Treat the first channel as lightness, not color.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> roughness = filters.estimateroughness("photo.png", middle=0.5)
    """
@overload
def estimateroughness(
    source: ImageLike,
    /,
    *,
    sigma: float | None = None,
    middle: float = 0.6,
    spread: float = 0.3,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
def fill(
    exemplar: ImageLike,
    region: ImageLike | None = None,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    source: ImageLike | None = None,
    mattes: ImageLike | None = None,
    replace: int | None = None,
    matte: str | None = None,
    matchlight: float | None = None,
    drift: FileName | Literal[False] = False,
    seamzone: int = 0,
    fade: float = 4.0,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    lattice: float = 0.5,
    iterations: int = 30,
    equaluse: float = 0.01,
    relevel: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Fill a region of a photo with texture from the rest of it, or from another photo.

    PatchMatch finds patches that fit the surroundings, from coarse to fine levels (BSFG09: Barnes, Shechtman,
    Finkelstein, Goldman, PatchMatch, SIGGRAPH 2009; levels as in MJH17). Each filled pixel is a copy of one source
    pixel with all channels. Close to the border, `fade` adjusts its color, so that no step is visible. With `source`,
    the copies take lighting and color level from the surroundings. Pixels outside the region stay bit-identical,
    except in the zone of `seamzone`.

    If some pixels of the region are already known, for example from the previous frame, paste them into the photo and
    mark only the rest: the fill continues them like all other pixels. To exclude them as a source, use `mask`.

    Parameters
    ----------
    exemplar : ImageLike
        Photo; of the maps of a material, the first.
    region : ImageLike | None
        Image that marks the pixels to replace (first channel above half its range, or a nonzero label
        id). Not used with replace or matte. On the stack, it comes after the maps.
    mask : ImageLike | None, default None
        Image that marks the valid source pixels, of the photo or of source (first channel above half
        its range, or a nonzero label id). A string is the name of a part of the first image, or a file
        name.
    source : ImageLike | None, default None
        Another photo to fill from, of any size and color space. With kinds, its first parts are the
        maps. A string is the name of a part of the first image, or a file name.
    maps : Sequence[ImageLike], default ()
        Further maps, resynthesized from the same source pixels. A string is the name of a part of the
        first image, or a file name.
    replace : int | None, default None
        Id of a label to replace, from the photo's label maps. Expected: an integer >= 1.
    matte : str | None, default None
        Object to replace, from the photo's Cryptomatte: its name, or its id in hexadecimal. Pixels that
        it covers partly are also replaced.
    matchlight : float | None, default None
        Fraction of the difference in lighting and color level that is corrected, including the step at
        the border. Set it to 1 for sky or plain walls. 0: every pixel is a verbatim copy. Expected: a
        number from 0 to 1. Default: 1 with source, else 0.
    seamzone : int, default 0
        Width of a zone around the region in which the fill's border follows a minimum-error seam
        (KSE03). Pixels in the zone may be replaced. 0: only the region is replaced. Expected: an
        integer from 0 to 256 px.
    fade : float, default 4.0
        Width over which the step at the border fades out into the fill. 0: none; without matchlight,
        every pixel is then a verbatim copy. Expected: a number from 0 to 256 px.
    patch : Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None, default None
        Side of a patch, in pixels. Structures up to this size are copied whole. Increase it if bricks
        or stones are cut. Expected: one of 5, 7, 9, 11, 13, 15, 17, 19, 21. Default: 11.
    kinds : Sequence[str] | None, default None
        Kind of each map of a material: color, data, normal or height. The last images on the stack are
        used, one for each kind, in order. Maps other than color are tagged as data in the result.
        Default: one map: color; with data=1, data.
    label : int | None, default None
        Id of a label in the exemplar's label maps. Only pixels of that label are used as a source.
        Expected: an integer >= 1.
    seed : int, default 0
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]
        A dict of parts by name if more than one part is requested.
        A list of these if several images are made.
        - fill: The photo with the region filled. One image for each of the maps, in order. [pixels]
        - st: Source coordinates of every pixel; with source, B is 1 where they refer to that photo.
          [32-bit float coordinates; with st]
        - drift: Correction of the copied pixels: Lab x gain + offset. Channels as in `flatten`. [32-bit
          float values; with drift]
        - report: Measures of the result, for programs. [JSON; with report]

    Other Parameters
    ----------------
    labels : ImageLike | None, default None
        Label maps of the exemplar, if they are not stored as its parts. A string is the name of a part
        of the first image, or a file name.
    mattes : ImageLike | None, default None
        Cryptomatte image, if the photo's file has none. A string is the name of a part of the first
        image, or a file name.
    drift : bool | FileName, default False
        Correction of the copied pixels. 1: append it as part 'drift'; a file name: write it to that
        file.
    tiled : Literal['none', 'x', 'y', 'xy'], default 'none'
        Axes along which the photo tiles: the fill continues across these borders.
    lattice : float, default 0.5
        Strength with which the photo's regular repeats (tiles, courses, weaves) are continued. 0: not
        continued. No effect with source, or on photos without regular repeats. Expected: a number from
        0 to 1.
    iterations : int, default 30
        Number of iterations on the coarsest level. Expected: an integer from 1 to 1000.
    equaluse : float, default 0.01
        Strength with which all parts of the source are used equally often (MJH17 eq. 6). Expected: a
        number from 0 to 1.
    relevel : bool, default False
        Raise or lower each copied piece of a height map so that pieces meet without steps. Set it if
        displaced heights show cliffs. Requires kinds=...,height.
    report : FileName | None, default None
        JSON file for the measures of the result (see docs/reference/report.md).
    fail : Sequence[str] | None, default None
        Conditions that count as failure, such as fidelity<0.8,seam>1.5. If one is true, the result is
        still written, but the exit code is 3.
    mapweights : float | Sequence[float] | None, default None
        Weight of each map in the comparison of patches, in order. 0: the map is not compared, but
        follows the others. Expected: a number or a sequence of numbers >= 0. Default: 1 for each map,
        0.25 for a height.
    labellevel : int | None, default None
        Level of the label maps: N selects the part label.N. 1 is the finest. Expected: an integer >= 1.
        Default: the coarsest with several labels.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that
        file.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> import numpy as np
    >>> region = np.tri(96, k=-60)  # the lower left corner
    >>> clean = filters.fill("photo.png", region, seed=7)
    """
@overload
def fill(
    exemplar: ImageLike,
    region: ImageLike | None = None,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    source: ImageLike | None = None,
    mattes: ImageLike | None = None,
    replace: int | None = None,
    matte: str | None = None,
    matchlight: float | None = None,
    drift: Literal[True],
    seamzone: int = 0,
    fade: float = 4.0,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    lattice: float = 0.5,
    iterations: int = 30,
    equaluse: float = 0.01,
    relevel: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def fill(
    exemplar: ImageLike,
    region: ImageLike | None = None,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    source: ImageLike | None = None,
    mattes: ImageLike | None = None,
    replace: int | None = None,
    matte: str | None = None,
    matchlight: float | None = None,
    drift: bool | FileName = False,
    seamzone: int = 0,
    fade: float = 4.0,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    lattice: float = 0.5,
    iterations: int = 30,
    equaluse: float = 0.01,
    relevel: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def fill(
    exemplar: ImageLike,
    region: ImageLike | None = None,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    source: ImageLike | None = None,
    mattes: ImageLike | None = None,
    maps: Sequence[ImageLike] = (),
    replace: int | None = None,
    matte: str | None = None,
    matchlight: float | None = None,
    drift: bool | FileName = False,
    seamzone: int = 0,
    fade: float = 4.0,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    lattice: float = 0.5,
    iterations: int = 30,
    equaluse: float = 0.01,
    relevel: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]: ...
@overload
def fill(
    exemplar: ImageLike,
    region: ImageLike | None = None,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    source: ImageLike | None = None,
    mattes: ImageLike | None = None,
    maps: Sequence[ImageLike] = (),
    replace: int | None = None,
    matte: str | None = None,
    matchlight: float | None = None,
    drift: bool | FileName = False,
    seamzone: int = 0,
    fade: float = 4.0,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    lattice: float = 0.5,
    iterations: int = 30,
    equaluse: float = 0.01,
    relevel: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def flatten(
    source: Picture,
    /,
    *,
    mask: ImageLike | None = None,
    radius: float | None = None,
    flattening: float = 1.0,
    localcontrast: float = 1.0,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    tone: Literal['photo', 'gray'] = 'photo',
    drift: FileName | Literal[False] = False,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Remove low-frequency variation (gradients of light, stains) from an image.

    Local level and local contrast in Lab, as medians over a disc, are matched to those of the whole image. Structures
    smaller than the disc are kept; larger stains are removed, including their rims. The result is the image times a
    smooth gain, from 1/2 to 2, plus a smooth offset in Lab. Memory does not grow with the image.

    Parameters
    ----------
    source : ImageLike
        Image to flatten.
    mask : ImageLike | None, default None
        Image that marks the valid source pixels (first channel above half its range, or a nonzero label
        id). A string is the name of a part of the first image, or a file name.
    radius : float | None, default None
        Radius of the disc. Smaller structures are kept. Reduce it if stains remain, increase it if the
        texture looks flat. Expected: a number from 1 to 1000000 px. Default: 0.2 x longer side.
    flattening : float, default 1.0
        Fraction of the low-frequency variation to remove. Expected: a number from 0 to 1.
    localcontrast : float, default 1.0
        Fraction of the variation in local contrast to remove. Reduce it if dark joints become gray.
        Expected: a number from 0 to 1.
    tiled : Literal['none', 'x', 'y', 'xy'], default 'none'
        Axes along which the image tiles. The result then tiles along the same axes.
    tone : Literal['photo', 'gray'], default 'photo'
        Overall color of the result. photo: the median of the photo's local levels; gray: middle gray (L
        50, a 0, b 0), which makes photos comparable.
    drift : bool | FileName, default False
        Correction that removes gradients and stains. 1: append it as part 'drift'; a file name: write
        it to that file.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - flat: Flattened image, in its own color space and type. Other channels are copied. [pixels]
        - drift: Correction: Lab x gain + offset. Channels: gain.L, gain.a, gain.b, offset.L, offset.a,
          offset.b. [32-bit float values; with drift]

    Other Parameters
    ----------------
    data : bool, default False
        Treat the channels as data, not color.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> flat = filters.flatten("photo.png", flattening=0.5)
    """
@overload
def flatten(
    source: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    radius: float | None = None,
    flattening: float = 1.0,
    localcontrast: float = 1.0,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    tone: Literal['photo', 'gray'] = 'photo',
    drift: Literal[True],
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def flatten(
    source: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    radius: float | None = None,
    flattening: float = 1.0,
    localcontrast: float = 1.0,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    tone: Literal['photo', 'gray'] = 'photo',
    drift: bool | FileName = False,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def flatten(
    source: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    radius: float | None = None,
    flattening: float = 1.0,
    localcontrast: float = 1.0,
    tiled: Literal['none', 'x', 'y', 'xy'] = 'none',
    tone: Literal['photo', 'gray'] = 'photo',
    drift: bool | FileName = False,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def graph(
    *photos: ImageLike,
    draw: FileName | None = None,
    graphfile: FileName | None = None,
    ratio: float | Sequence[float] | None = None,
    loop: int | None = None,
    scales: int = 1,
    exemplarside: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    panel: int = 128,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Create an exemplar graph from one or more photos, or draw an existing graph.

    An exemplar graph says which photo supplies finer detail for which (an edge), and how many octaves finer it is
    (r). Several photos, coarsest first, become a chain: each has pixels `ratio` times smaller than the one before.
    A single photo gets an edge to itself, for an unbounded zoom; with `scales`, a chain of exemplars is cut out of
    it, from the whole photo at reduced resolution to a crop at full resolution.

    graphfile=FILE writes the graph for `synth` and `zoom`. You can edit it; file names are relative to the graph. The
    picture arranges exemplars by octave and labels edges with r (HRRG08: Han, Risser, Ramamoorthi, Grinspun,
    Multiscale Texture Synthesis, 2008, section 3.1, figures 8 and 9).

    Parameters
    ----------
    *photos : ImageLike
        Photos, coarsest first. None are taken if graph is given.
    draw : FileName | None, default None
        Existing graph to draw (JSON or YAML), instead of creating one.
    graphfile : FileName | None, default None
        File for the graph.
    ratio : float | Sequence[float] | None, default None
        Ratio between the pixel sizes of each photo and the next, or one ratio for all. Expected: a
        number or a sequence of numbers >= 1. Default: 8, less for small photos; with scales, 2.
    loop : int | None, default None
        Octaves after which the last exemplar continues in itself, which makes a zoom endless. 0: the
        zoom ends. Expected: an integer from 0 to 7. Default: 1 for one photo, else 0.
    scales : int, default 1
        Number of exemplars at different scales to cut out of one photo. They are written next to
        graphfile. Expected: an integer from 1 to 16.
    exemplarside : Literal[16, 32, 64, 128, 256, 512, 1024], default 256
        Maximum side of an exemplar. Expected: one of 16, 32, 64, 128, 256, 512, 1024.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - picture: Diagram of exemplars and edges. [8-bit sRGB picture]
        - graphfile: Graph for `synth` and `zoom`. [JSON; with graphfile]
        - exemplar.N: Crop of the photo reduced N times, next to the graph; with scales. [pixels; with
          graphfile]

    Other Parameters
    ----------------
    panel : int, default 128
        Side of an exemplar in the picture. Expected: an integer from 32 to 512 px.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> drawing = filters.graph("photo.png", graphfile="graph.json")
    >>> texture = filters.synth(None, graph="graph.json", size=(256, 256))
    """
@overload
def graph(
    *photos: ImageLike,
    draw: FileName | None = None,
    graphfile: FileName | None = None,
    ratio: float | Sequence[float] | None = None,
    loop: int | None = None,
    scales: int = 1,
    exemplarside: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    panel: int = 128,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
def join(
    *shares: ImageLike,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]:
    """Join crops of an image that were rendered separately, as on a farm.

    Takes all images on the stack, in any order. They must be crops of one display window, as `synth` renders them with
    `window`, and must cover it. They must have the same channels, pixel type and parts, and must be equal
    where they overlap. The result has the same pixels as a single run.

    Parameters
    ----------
    *shares : ImageLike
        Crops to join, in any order.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        - joined: Whole image, with all parts. [pixels]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> import OpenImageIO as oiio
    >>> halves = [filters.flatten("photo.png", roi=oiio.ROI(x, x + 48, 0, 96)) for x in (0, 48)]  # of 96 x 96 px
    >>> joined = filters.join(*halves)
    """
@overload
def join(
    *shares: ImageLike,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

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
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Convert to and from CIE Lab (D65).

    L is 0 for black and 100 for diffuse white; a and b are 0 for gray. HDR values exceed 100, and negative values are
    kept. L, a and b are stored as 32-bit floats in channels R, G and B, as OpenColorIO does, because most programs take
    a channel named 'a' for alpha. Gray images become three channels. Color is unpremultiplied first, and premultiplied
    again by the inverse; alpha and other channels are kept. The result is tagged as data, so that no program takes it
    for RGB. An attribute records the original color space for the inverse.

    Parameters
    ----------
    source : ImageLike
        Image to convert.
    inverse : bool, default False
        Convert from Lab to color.
    to : str | None, default None
        Color space of the result. Requires inverse. Default: the original color space.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - lab: L, a and b in channels R, G and B. [32-bit float values]
        - color: Color, in the type of the first input file. [pixels; with inverse]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> lab = filters.lab("photo.png")
    >>> lightness = lab.get_pixels()[..., 0]
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
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
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
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def label(
    source: ImageLike,
    /,
    *,
    features: Literal['textons', 'moments', 'gabor', 'quadtree'] = 'textons',
    persistence: float = 0.95,
    coarsest: bool = True,
    materials: bool = False,
    maxlabels: int | None = None,
    paper: Literal[False, True, 'authors'] = False,
    photo: Literal[True],
    membership: bool = False,
    cryptomatte: bool | FileName = False,
    palette: FileName | None = None,
    onepart: bool = False,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]:
    """Segment an image into labels at several scales, without training.

    Similar superpixels get the same label, and the image determines the number of labels (LSA16: Lockerman, Sauvage,
    Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016). The
    result has a part for each scale, from label.1, the finest, to the coarsest. Each label of a level lies within one
    label of the next level, its parent. Ids are 1, 2, ... of type uint32, and 0 only where alpha is 0: write them to
    EXR or TIFF. With `photo` the photo is the first part. Attributes of a part record its scale in px (oiiotex:rho),
    its number of labels (oiiotex:labels) and their parents, in order (oiiotex:parents).

    Parameters
    ----------
    source : ImageLike
        Image to segment.
    persistence : float, default 0.95
        Persistence of the random walk over superpixels (LSA16 section 4.4). Reduce it for fewer labels.
        Level n uses its nth power. Expected: a number from 0.01 to 0.999.
    coarsest : bool, default True
        Add a coarsest level of subtextures, as `decompose` finds them. The paper has none.
    materials : bool, default False
        Add a coarsest level of up to four materials, such as stone and mortar: superpixels are split by
        color and texture where these have two separate modes. If they do not, no level is added.
    maxlabels : int | None, default None
        Maximum number of subtextures in the coarsest level. Expected: an integer from 1 to 50. Default:
        chosen by the filter.
    paper : Literal[False, True, 'authors'], default False
        Settings of the paper (LSA16): features=moments:persistence=0.95:coarsest=0, the best of ten
        SLIC runs, superpixels of at least 25 px, five additional random starts, a level only where it
        splits all superpixels of the coarser one, the same persistence at all levels, and labels split
        wherever a coarser border crosses them. authors: the program that the authors published, which
        has at least two levels, and scales up to 30 % of the longer side instead of 20 % of the shorter
        one.
    photo : bool, default False
        Keep the photo as the first part, before the labels.
    cryptomatte : bool | FileName, default False
        Append Cryptomatte 1.2 of all levels as a part. A file name: also write the manifest to that
        file.
    palette : FileName | None, default None
        Table from `palette`, whose names are written to label parts and Cryptomatte.
    facts : FileName | None, default None
        File for scales, number and areas of labels, and their tree.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - photo: Photo, as the first part. [pixels; with photo]
        - label.N: Label map at level N; 1 is the finest. [32-bit ids]
        - membership.N: Membership G at level N, a channel for each label. [32-bit float values; with
          membership]
        - fit.N: Fit F / max F at level N, a channel for each label. [32-bit float values; with
          membership]
        - cryptomatte: All levels as Cryptomatte. [Cryptomatte 1.2; with cryptomatte]
        - facts: Scales, number and areas of labels, and their tree. [JSON; with facts]

    Other Parameters
    ----------------
    features : Literal['textons', 'moments', 'gabor', 'quadtree'], default 'textons'
        Features by which superpixels are compared. Keep textons (frequent local patterns), except for
        comparison. The paper uses moments.
    membership : bool, default False
        Append soft label maps for each level N: membership.N is how much a pixel belongs to each label,
        fit.N how typical it is of the label (G and F / max F in LSA16).
    onepart : bool, default False
        Output as one unnamed part with the channels of the image and of Cryptomatte, as Blender and
        Nuke expect. Requires cryptomatte.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> levels = filters.label("photo.png")
    >>> list(levels)[0]
    'label.1'
    """
@overload
def label(
    source: ImageLike,
    /,
    *,
    features: Literal['textons', 'moments', 'gabor', 'quadtree'] = 'textons',
    persistence: float = 0.95,
    coarsest: bool = True,
    materials: bool = False,
    maxlabels: int | None = None,
    paper: Literal[False, True, 'authors'] = False,
    photo: bool = False,
    membership: bool = False,
    cryptomatte: Literal[True],
    palette: FileName | None = None,
    onepart: bool = False,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def label(
    source: ImageLike,
    /,
    *,
    features: Literal['textons', 'moments', 'gabor', 'quadtree'] = 'textons',
    persistence: float = 0.95,
    coarsest: bool = True,
    materials: bool = False,
    maxlabels: int | None = None,
    paper: Literal[False, True, 'authors'] = False,
    photo: bool = False,
    membership: bool = False,
    cryptomatte: bool | FileName = False,
    palette: FileName | None = None,
    onepart: bool = False,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def label(
    source: ImageLike,
    /,
    *,
    features: Literal['textons', 'moments', 'gabor', 'quadtree'] = 'textons',
    persistence: float = 0.95,
    coarsest: bool = True,
    materials: bool = False,
    maxlabels: int | None = None,
    paper: Literal[False, True, 'authors'] = False,
    photo: bool = False,
    membership: bool = False,
    cryptomatte: bool | FileName = False,
    palette: FileName | None = None,
    onepart: bool = False,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def labelview(
    source: ImageLike,
    /,
    *,
    panel: int = 384,
    columns: int = 3,
    opacity: float = 0.65,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Visualize label maps as a contact sheet of all levels, with the tree of labels.

    Takes the result of `label` or `superpixel`, preferably with `photo`. The sheet shows the photo, then each label
    part (uint32, one channel) in colors that color-blind viewers can distinguish, over the lightness of the photo
    and with borders. The tree has the coarsest labels at its top; the width of a node is the area of its label. The
    result is an 8-bit sRGB image, subsampled from the labels, for display, not for measurement.

    Parameters
    ----------
    source : ImageLike
        Image with label parts, from `label` or `superpixel` with `photo`.
    panel : int, default 384
        Longer side of a panel. Expected: an integer from 64 to 4096 px.
    columns : int, default 3
        Number of panels in a row. Expected: an integer from 1 to 16.
    opacity : float, default 0.65
        Opacity of the label colors over the photo. Expected: a number from 0 to 1.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - view: Contact sheet. [8-bit sRGB picture]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> sheet = filters.labelview(filters.label("photo.png", photo=True))
    """
@overload
def labelview(
    source: ImageLike,
    /,
    *,
    panel: int = 384,
    columns: int = 3,
    opacity: float = 0.65,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
def paint(
    exemplar: ImageLike,
    painting: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    fine: ImageLike | None = None,
    labellevel: int | None = None,
    palette: FileName | None = None,
    tolerance: float = 0.2,
    size: tuple[int, int] | None = None,
    planfile: FileName | None = None,
    fromplan: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: Literal[False] = False,
    data: bool = False,
    seed: int = 0,
    st: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Turn a painting of labels into a texture, at one or two scales.

    Areas painted with label 3 are filled with the photo's texture of label 3, by guided quilting (`quilt`). An
    optional second painting, `fine`, overlays labels of the next finer level; where it is empty (black, id 0 or alpha
    0), the first painting applies (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale
    Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016, section 6.2). palette=FILE from `palette` maps colors to
    labels; paintings of ids do not need it. To edit a result, write planfile=FILE and pass it as fromplan=FILE to
    the next run: patches whose labels did not change are kept, so pixels elsewhere are bit-identical.

    Parameters
    ----------
    exemplar : ImageLike
        Photo. Where labels are used, with the label maps that `label` with `photo` creates.
    painting : ImageLike
        Painting of any size: label ids, or colors that `palette` maps to labels.
    fine : ImageLike | None, default None
        Painting of labels of the next finer level, overlaid on the first. A string is the name of a
        part of the first image, or a file name.
    labellevel : int | None, default None
        Level of the painted labels: N of label.N. Expected: an integer >= 1. Default: the table's
        level, else the coarsest with several labels.
    palette : FileName | None, default None
        JSON table from `palette` (its facts), which maps colors to labels.
    size : tuple[int, int] | None, default None
        Size of the result. Expected: (width, height) from 8 to 4194304 px. Default: the painting's
        size.
    planfile : FileName | None, default None
        File (.npz) to write for a later edit: the next run reads it with `fromplan`.
    fromplan : FileName | None, default None
        Plan of an earlier run. Patches whose labels did not change are kept.
    tiles : Literal['none', 'x', 'y', 'xy'], default 'none'
        Axes along which the result tiles.
    patch : int | None, default None
        Side of a patch. Increase it to preserve larger structures, decrease it for more variation.
        Expected: an integer from 8 to 256 px. Default: the labels' scale or, without labels, shorter
        side / 8, as a power of two; less if a label is rare.
    guideweight : float, default 1.0
        Weight of the guide's labels inside a patch, compared with color. Increase it to follow the
        guide more closely. Expected: a number from 0 to 100.
    labelmaps : bool, default False
        Append the label maps of the result as parts label.N, rearranged exactly as its pixels.
    seed : int, default 0
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - paint: Pixels copied from the photo, all channels together, in its color space and type.
          [pixels]
        - st: Source coordinates of every pixel, for `warp` and `st_warp`. [32-bit float coordinates;
          with st]
        - label.N: Label parts of the photo, copied from the same source pixels. [32-bit ids; with
          labelmaps]
        - planfile: Painted labels and the patches used for them. [.npz; with planfile]
        - report: Measures of the result, for programs. [JSON; with report]

    Other Parameters
    ----------------
    labels : ImageLike | None, default None
        Label maps of the exemplar, if they are not stored as its parts. A string is the name of a part
        of the first image, or a file name.
    tolerance : float, default 0.2
        Largest distance, in Oklab, at which a color counts as the nearest color of the table. Black and
        white are 1 apart. Blends of soft brushes lie within 0.2 of the colors of `palette`. 0: exact
        colors only. Expected: a number from 0 to 1.
    report : FileName | None, default None
        JSON file for the measures of the result (see docs/reference/report.md).
    fail : Sequence[str] | None, default None
        Conditions that count as failure, such as fidelity<0.8,seam>1.5. If one is true, the result is
        still written, but the exit code is 3.
    candidates : int, default 256
        Maximum number of candidate patches per place. Expected: an integer from 1 to 65536.
    freeuses : float, default 1.0
        Number of times that a region of the exemplar may be copied before further copies are penalized,
        relative to equal use of all regions. Two copies are always free. Reduce it if regions repeat,
        increase it if patches match poorly. Expected: a number from 0 to 1000000000.
    finerweight : float, default 0.5
        Weight of finer levels' labels in the overlaps, compared with color. Expected: a number from 0
        to 100.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that
        file.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> import numpy as np
    >>> photo = filters.label("photo.png", photo=True)
    >>> painting = np.ones((300, 400), np.uint32)  # label 1 everywhere
    >>> texture = filters.paint(photo, painting)
    """
@overload
def paint(
    exemplar: ImageLike,
    painting: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    fine: ImageLike | None = None,
    labellevel: int | None = None,
    palette: FileName | None = None,
    tolerance: float = 0.2,
    size: tuple[int, int] | None = None,
    planfile: FileName | None = None,
    fromplan: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: bool = False,
    data: bool = False,
    seed: int = 0,
    st: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def paint(
    exemplar: ImageLike,
    painting: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    fine: ImageLike | None = None,
    labellevel: int | None = None,
    palette: FileName | None = None,
    tolerance: float = 0.2,
    size: tuple[int, int] | None = None,
    planfile: FileName | None = None,
    fromplan: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: bool = False,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def paint(
    exemplar: ImageLike,
    painting: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    fine: ImageLike | None = None,
    labellevel: int | None = None,
    palette: FileName | None = None,
    tolerance: float = 0.2,
    size: tuple[int, int] | None = None,
    planfile: FileName | None = None,
    fromplan: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: bool = False,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def palette(
    exemplar: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    panel: int = 96,
    maxlabels: int = 24,
    children: int = 8,
    chips: FileName | Literal[False] = False,
    paints: FileName | None = None,
    facts: FileName | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Create a chart of the labels of a texture: a row for each label, with its sublabels.

    A row starts with texture synthesized from the pixels of one label only. To its right are its children on the next
    finer level (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map Extraction for
    Texture Synthesis, SIGGRAPH 2016, section 6.2, figures 13 and 14). The largest label is on top. json=FILE writes the
    table for `paint`: id, name, paint color, area, parent, children and position in the chart of each label.
    paints=FILE writes the colors as a palette for painting programs, and `chips` draws them.

    Parameters
    ----------
    exemplar : ImageLike
        Photo. Where labels are used, with the label maps that `label` with `photo` creates.
    panel : int, default 96
        Height of a row. Expected: an integer from 16 to 1024 px.
    maxlabels : int, default 24
        Maximum number of labels, the largest first. Expected: an integer from 1 to 256.
    children : int, default 8
        Maximum number of children of each label, the largest first. Expected: an integer from 0 to 64.
    chips : bool | FileName, default False
        Paint colors with ids and names. 1: append them as part 'chips'; a file name: write them to that
        file.
    paints : FileName | None, default None
        File for the paint colors (.gpl or .aco), to load into a painting program.
    facts : FileName | None, default None
        File for ids, names, colors, areas, parents, children and boxes of labels.
    seed : int, default 0
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - palette: Rows of texture, copied from the photo, in its own color space and type. [pixels]
        - st: Source coordinates of every pixel, for `warp` and `st_warp`. [32-bit float coordinates;
          with st]
        - chips: Paint colors with ids and names, laid out like the palette. [8-bit sRGB picture; with
          chips]
        - paints: Named paint colors for GIMP, Krita and Inkscape, or Photoshop. [.gpl or .aco; with
          paints]
        - facts: Ids, names, colors, areas, parents, children and boxes of labels. [JSON; with facts]

    Other Parameters
    ----------------
    labels : ImageLike | None, default None
        Label maps of the exemplar, if they are not stored as its parts. A string is the name of a part
        of the first image, or a file name.
    labellevel : int | None, default None
        Level of the label maps: N selects the part label.N. 1 is the finest. Expected: an integer >= 1.
        Default: the coarsest with several labels.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that
        file.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> photo = filters.label("photo.png", photo=True)
    >>> sheet = filters.palette(photo)
    """
@overload
def palette(
    exemplar: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    panel: int = 96,
    maxlabels: int = 24,
    children: int = 8,
    chips: Literal[True],
    paints: FileName | None = None,
    facts: FileName | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def palette(
    exemplar: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    panel: int = 96,
    maxlabels: int = 24,
    children: int = 8,
    chips: bool | FileName = False,
    paints: FileName | None = None,
    facts: FileName | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def palette(
    exemplar: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    panel: int = 96,
    maxlabels: int = 24,
    children: int = 8,
    chips: bool | FileName = False,
    paints: FileName | None = None,
    facts: FileName | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def palette(
    exemplar: ImageLike,
    /,
    *,
    labels: ImageLike | None = None,
    panel: int = 96,
    maxlabels: int = 24,
    children: int = 8,
    chips: bool | FileName = False,
    paints: FileName | None = None,
    facts: FileName | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def patchmatch(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    weightmap: ImageLike | None = None,
    histogram: float = 1.0,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    variants: Literal[1] = 1,
    pack: Literal['atlas'] | None = None,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    equaluse: float = 0.01,
    repeatpenalty: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Resynthesize a photo by PatchMatch alone, for comparison: the baseline of MJH17 (section 5.2).

    This is `stationarize` without flattening and without evening out local statistics: use it to see what these
    add. `tiles=xy` is the paper's toroidal PatchMatch, `tiles=none` its plain PatchMatch (MJH17: Moritz, James,
    Haines, Ritschel, Weyrich, Texture Stationarization, Eurographics 2017).

    Parameters
    ----------
    exemplar : ImageLike
        Photo; of the maps of a material, the first.
    mask : ImageLike | None, default None
        Image that marks the valid source pixels (first channel above half its range, or a nonzero label
        id). A string is the name of a part of the first image, or a file name.
    maps : Sequence[ImageLike], default ()
        Further maps, resynthesized from the same source pixels. A string is the name of a part of the
        first image, or a file name.
    size : Literal['pow2'] | tuple[int, int] | None, default None
        Size of the result. pow2: each side of the photo, rounded to the nearest power of two. Expected:
        'pow2' or (width, height) from 5 to 65536 px. Default: size of the photo.
    tiles : Literal['none', 'x', 'y', 'xy'], default 'xy'
        Axes along which the result tiles.
    variants : int, default 1
        Number of interchangeable tiles. 2 to 7: any tile fits next to any other. 8 or more: Wang tiles,
        which fit where edge colors agree; 16 or more are a complete set with two corner colors. Part
        names and the attribute oiiotex:edges contain the edge colors. Expected: an integer from 1 to
        64.
    pack : Literal['atlas'] | None, default None
        Arrangement of the tiles. atlas: one image in which neighbors share an edge, also across its
        borders, so that renderers can filter it without padding. Requires variants=4, 16 or 64.
        Default: one image for each tile.
    patch : Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None, default None
        Side of a patch, in pixels. Structures up to this size are copied whole. Increase it if bricks
        or stones are cut. Expected: one of 5, 7, 9, 11, 13, 15, 17, 19, 21. Default: 13.
    kinds : Sequence[str] | None, default None
        Kind of each map of a material: color, data, normal or height. The last images on the stack are
        used, one for each kind, in order. Maps other than color are tagged as data in the result.
        Default: one map: color; with data=1, data.
    label : int | None, default None
        Id of a label in the exemplar's label maps. Only pixels of that label are used as a source.
        Expected: an integer >= 1.
    seed : int, default 0
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]
        A dict of parts by name if more than one part is requested.
        A list of these if several images are made.
        - tile: Pixels copied from the photo, all channels together, in its color space and type. One
          image for each of the maps, in order, and for each variant. [pixels]
        - st: Source coordinates of every pixel, for `warp` and `st_warp`. [32-bit float coordinates;
          with st]
        - report: Measures of the result, for programs. [JSON; with report]

    Other Parameters
    ----------------
    labels : ImageLike | None, default None
        Label maps of the exemplar, if they are not stored as its parts. A string is the name of a part
        of the first image, or a file name.
    weightmap : ImageLike | None, default None
        Image of relative weights, in its first channel: pixels of weight 2 are used twice as often as
        pixels of weight 1, and pixels of weight 0 are never used. A string is the name of a part of the
        first image, or a file name.
    histogram : float, default 1.0
        Strength of histogram matching to the photo at the start. It falls to 0 during the iterations of
        the coarsest level. Expected: a number from 0 to 1.
    relevel : bool, default False
        Raise or lower each copied piece of a height map so that pieces meet without steps. Set it if
        displaced heights show cliffs. Requires kinds=...,height.
    iterations : int, default 30
        Number of iterations on the coarsest level. Each finer level has one. Increase it if a warning
        says that texture is lost. Expected: an integer from 1 to 1000.
    equaluse : float, default 0.01
        Strength with which all parts of the photo are used equally often (MJH17 eq. 6). Increase it to
        use more of the photo. Above 0.1, structures break up. Expected: a number from 0 to 1.
    repeatpenalty : float, default 1.0
        Weight of the penalty for regions of the photo that are used more than twice. At 0, the result
        is closer to the photo and repeats more. Expected: a number from 0 to 1.
    resume : bool, default False
        Save a checkpoint after each pyramid level next to the output, in the folder OUTPUT.parts. Run
        the same command again to resume.
    report : FileName | None, default None
        JSON file for the measures of the result (see docs/reference/report.md).
    fail : Sequence[str] | None, default None
        Conditions that count as failure, such as fidelity<0.8,seam>1.5. If one is true, the result is
        still written, but the exit code is 3.
    mapweights : float | Sequence[float] | None, default None
        Weight of each map in the comparison of patches, in order. 0: the map is not compared, but
        follows the others. Expected: a number or a sequence of numbers >= 0. Default: 1 for each map,
        0.25 for a height.
    labellevel : int | None, default None
        Level of the label maps: N selects the part label.N. 1 is the finest. Expected: an integer >= 1.
        Default: the coarsest with several labels.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that
        file.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> tile = filters.patchmatch("photo.png", seed=7)
    """
@overload
def patchmatch(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    weightmap: ImageLike | None = None,
    histogram: float = 1.0,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    variants: Literal[1] = 1,
    pack: Literal['atlas'] | None = None,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    equaluse: float = 0.01,
    repeatpenalty: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def patchmatch(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    weightmap: ImageLike | None = None,
    maps: Sequence[ImageLike] = (),
    histogram: float = 1.0,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    variants: int = 1,
    pack: Literal['atlas'] | None = None,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    equaluse: float = 0.01,
    repeatpenalty: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]: ...
@overload
def patchmatch(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    weightmap: ImageLike | None = None,
    maps: Sequence[ImageLike] = (),
    histogram: float = 1.0,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    variants: int = 1,
    pack: Literal['atlas'] | None = None,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    equaluse: float = 0.01,
    repeatpenalty: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def plate(
    source: ImageLike,
    /,
    *,
    region: ImageLike | None = None,
    frames: str | None = None,
    motion: FileName | None = None,
    vectors: Literal['st', 'backward', 'forward'] = 'st',
    flip: bool = False,
    motionfile: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Assemble a clean plate of a shot: the surface that an object hides, from all frames that show it.

    The motion of the surface is tracked around the region (a homography for each frame), or given by `motion`. The
    plate is aligned with the reference frame, and extends to what other frames show. Its resolution is that of the
    frame that shows the region largest. It has little grain, because it is a mean of frames.

    Pixels that no frame shows are transparent. Those that frames need are white in part 'region': fill them once with
    `fill`, then render the plate into every frame with `project`. All frames show the same fill, so it does not
    flicker, and each is resampled once.

    Parameters
    ----------
    source : ImageLike
        Reference frame of the shot. The plate is aligned with it.
    region : ImageLike | None, default None
        Mask of the reference frame. White is replaced, in all frames. A string is the name of a part of
        the first image, or a file name.
    frames : str | None, default None
        Frames of the shot, FIRST-LAST. The files of other frames, masks and motion images are found by
        the frame number in their names. A mask without a number is used for all frames. Default: the
        reference frame alone.
    motion : FileName | None, default None
        Motion of the surface: the image for the reference frame, in the convention of `vectors`, or a
        file written by `motionfile`. Default: tracked.
    vectors : Literal['st', 'backward', 'forward'], default 'st'
        Convention of `motion`. st: position in the reference frame, from 0 to 1; backward, forward:
        vectors in pixels to the previous or the next frame. Channels are s and t, backward.u and
        backward.v, or forward.u and forward.v, otherwise the first two.
    flip : bool, default False
        Read `motion` with t or v pointing up, as in Nuke and Blender.
    motionfile : FileName | None, default None
        File to write the motion of all frames to, for `project`.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - plate: The surface, in the frames' color space and type. Alpha is 0 where no frame shows it.
          [pixels]
        - region: Pixels to fill: frames need them, and none shows them. [0 or 1, 32-bit floats]
        - motionfile: Frames and their matrices, from frame to plate, for `project`. [.npz; with
          motionfile]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> plate = filters.plate("photo.png")
    """
@overload
def plate(
    source: ImageLike,
    /,
    *,
    region: ImageLike | None = None,
    frames: str | None = None,
    motion: FileName | None = None,
    vectors: Literal['st', 'backward', 'forward'] = 'st',
    flip: bool = False,
    motionfile: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
def preview(
    tile: ImageLike,
    /,
    *,
    exemplar: ImageLike | None = None,
    panels: Sequence[str] | None = None,
    panel: int = 512,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Preview a tile as it will be used: repeated 2 x 2 and 3 x 3, and on a plane in perspective.

    The plane extends to the horizon, where any repetition becomes visible (the stress test of MJH17, section 5.2). With
    `exemplar`, the preview also shows the photo, and the photo made seamless by blending it with itself shifted by
    half, as paint programs do.

    Every pixel is the mean of the area that it covers. Stored values are averaged without conversion: for correct
    brightness near the horizon, convert the tile to a linear color space first (OpenImageIO's `colorconvert`).

    Parameters
    ----------
    tile : ImageLike
        Tile to preview.
    exemplar : ImageLike | None, default None
        Photo from which the tile was made. A string is the name of a part of the first image, or a file
        name.
    panels : Sequence[str] | None, default None
        Panels to show, in order: exemplar, seamless, 2x2, 3x3, plane. Default: all; without exemplar,
        2x2,3x3,plane.
    panel : int, default 512
        Height of each panel. Expected: an integer from 16 to 16384 px.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - preview: Panels side by side, in the tile's color space and type. [pixels]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> sheet = filters.preview(filters.stationarize("photo.png"), panels=["3x3"])
    """
@overload
def preview(
    tile: ImageLike,
    /,
    *,
    exemplar: ImageLike | None = None,
    panels: Sequence[str] | None = None,
    panel: int = 512,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
def project(
    source: ImageLike,
    plate: ImageLike,
    /,
    *,
    region: ImageLike | None = None,
    motion: FileName | None = None,
    frame: int | None = None,
    grain: float = 1.0,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Render a clean plate into a region of a frame, with the motion, the light and the grain of the shot.

    Each frame is sampled once from the plate (`plate`), so the fill moves with the surface and stays sharp. Its light
    level is matched to the frame around the region, and new grain like the frame's is added. Pixels outside the
    region, and channels that the plate lacks, are unchanged. Frames are independent, so they can be distributed,
    skipped and repeated.

    Parameters
    ----------
    source : ImageLike
        Frame of the shot.
    plate : ImageLike
        Clean plate, filled.
    region : ImageLike | None, default None
        Mask: white is replaced, gray is mixed. Without it, the whole frame is replaced. A string is the
        name of a part of the first image, or a file name.
    motion : FileName | None, default None
        Motion that `plate` saved. Default: none: the plate is aligned with the frame.
    frame : int | None, default None
        Number of the frame. Default: that of --frames, otherwise the only one.
    grain : float, default 1.0
        Amount of grain, as a multiple of the frame's. 0: none. Expected: a number from 0 to 4.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - frame: The frame with the plate in its region, in its own color space and type. [pixels]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> frame = filters.project("photo.png", "photo.png")
    """
@overload
def project(
    source: ImageLike,
    plate: ImageLike,
    /,
    *,
    region: ImageLike | None = None,
    motion: FileName | None = None,
    frame: int | None = None,
    grain: float = 1.0,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
def quilt(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    guide: ImageLike | None = None,
    label: int | None = None,
    palette: FileName | None = None,
    tolerance: float = 0.2,
    overlap: int | None = None,
    planfile: FileName | None = None,
    fromplan: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    size: tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: Literal[False] = False,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: FileName | Literal[False] = False,
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Synthesize a texture of any size from patches of a photo, joined along minimum-error cuts.

    Image quilting (Efros & Freeman, SIGGRAPH 2001) places square patches on a regular grid. Each patch is the best
    match for its neighbors, and is cut along the path of least difference.

    With label maps, a guide controls the layout: patches are selected by their content, the two most
    frequent labels in them (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier, Multi-Scale Label-Map
    Extraction for Texture Synthesis, SIGGRAPH 2016, section 6.1).

    Every pixel of the result is a copy of one pixel of the photo. Only a plan of offsets and cuts is kept in memory, so
    memory does not grow with the number of pixels.

    Parameters
    ----------
    exemplar : ImageLike
        Photo. Where labels are used, with the label maps that `label` with `photo` creates.
    mask : ImageLike | None, default None
        Image that marks the valid source pixels (first channel above half its range, or a nonzero label
        id). A string is the name of a part of the first image, or a file name.
    guide : ImageLike | None, default None
        Image of any size that controls the layout. Its pixels are label ids, or ids or colors that
        `palette` maps to labels. A string is the name of a part of the first image, or a file name.
    label : int | None, default None
        Id of a label in the exemplar's label maps. Only pixels of that label are used as a source.
        Expected: an integer >= 1.
    size : tuple[int, int] | None, default None
        Size of the result. Expected: (width, height) from 1 to 4194304 px. Default: size of the guide,
        else of the exemplar.
    tiles : Literal['none', 'x', 'y', 'xy'], default 'none'
        Axes along which the result tiles.
    patch : int | None, default None
        Side of a patch. Increase it to preserve larger structures, decrease it for more variation.
        Expected: an integer from 8 to 256 px. Default: the labels' scale or, without labels, shorter
        side / 8, as a power of two; less if a label is rare.
    guideweight : float, default 1.0
        Weight of the guide's labels inside a patch, compared with color. Increase it to follow the
        guide more closely. Expected: a number from 0 to 100.
    labelmaps : bool, default False
        Append the label maps of the result as parts label.N, rearranged exactly as its pixels.
    seed : int, default 0
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295.
    lattice : float, default 0.5
        Strength with which regular repeats (tiles, courses, weaves) are preserved. If the photo's size
        does not hold complete repeats, the result gets the nearest size that does, unless size is set.
        0: repeats are not preserved. No effect on photos without regular repeats. Expected: a number
        from 0 to 1.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - quilt: Pixels copied from the photo, all channels together, in its color space and type.
          [pixels]
        - st: Source coordinates of every pixel, for `warp` and `st_warp`. [32-bit float coordinates;
          with st]
        - label.N: Label parts of the photo, copied from the same source pixels. [32-bit ids; with
          labelmaps]
        - planfile: Plan of the quilt: offsets and cuts. [.npz; with planfile]
        - report: Measures of the result, for programs. [JSON; with report]

    Other Parameters
    ----------------
    labels : ImageLike | None, default None
        Label maps of the exemplar, if they are not stored as its parts. A string is the name of a part
        of the first image, or a file name.
    palette : FileName | None, default None
        JSON file that maps ids or 8-bit colors of the guide to labels or pairs of labels: {"255,0,0":
        3, "0,0,255": [1, 2]}.
    tolerance : float, default 0.2
        Largest distance, in Oklab, at which a color counts as the nearest color of the table. Black and
        white are 1 apart. Blends of soft brushes lie within 0.2 of the colors of `palette`. 0: exact
        colors only. Expected: a number from 0 to 1.
    overlap : int | None, default None
        Overlap of neighboring patches, at most patch / 3. Expected: an integer from 4 to 85 px.
        Default: patch / 4.
    planfile : FileName | None, default None
        File (.npz) to write the plan (offsets and cuts) to.
    fromplan : FileName | None, default None
        Plan of an earlier run to render instead of computing one. The exemplar may be another map of
        the same size.
    report : FileName | None, default None
        JSON file for the measures of the result (see docs/reference/report.md).
    fail : Sequence[str] | None, default None
        Conditions that count as failure, such as fidelity<0.8,seam>1.5. If one is true, the result is
        still written, but the exit code is 3.
    candidates : int, default 256
        Maximum number of candidate patches per place. Expected: an integer from 1 to 65536.
    freeuses : float, default 1.0
        Number of times that a region of the exemplar may be copied before further copies are penalized,
        relative to equal use of all regions. Two copies are always free. Reduce it if regions repeat,
        increase it if patches match poorly. Expected: a number from 0 to 1000000000.
    finerweight : float, default 0.5
        Weight of finer levels' labels in the overlaps, compared with color. Expected: a number from 0
        to 100.
    labellevel : int | None, default None
        Level of the label maps: N selects the part label.N. 1 is the finest. Expected: an integer >= 1.
        Default: the coarsest with several labels.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that
        file.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> texture = filters.quilt("photo.png", size=(1024, 512), seed=7)
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
    palette: FileName | None = None,
    tolerance: float = 0.2,
    overlap: int | None = None,
    planfile: FileName | None = None,
    fromplan: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    size: tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: bool = False,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: Literal[True],
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
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
    palette: FileName | None = None,
    tolerance: float = 0.2,
    overlap: int | None = None,
    planfile: FileName | None = None,
    fromplan: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    size: tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: bool = False,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def quilt(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    guide: ImageLike | None = None,
    label: int | None = None,
    palette: FileName | None = None,
    tolerance: float = 0.2,
    overlap: int | None = None,
    planfile: FileName | None = None,
    fromplan: FileName | None = None,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    size: tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'none',
    patch: int | None = None,
    candidates: int = 256,
    freeuses: float = 1.0,
    finerweight: float = 0.5,
    guideweight: float = 1.0,
    labelmaps: bool = False,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def rectify(
    source: ImageLike,
    /,
    *,
    corners: float | Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    meters: float | Sequence[float] | None = None,
    filter: Literal['lanczos3', 'mitchell', 'triangle'] = 'lanczos3',
    st: FileName | Literal[False] = False,
    facts: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Correct the perspective of a flat surface that was photographed obliquely.

    The four corners of a real rectangle become the corners of the result. The aspect ratio is derived from the
    perspective (Zhang and He 2007: square pixels, uncropped photo) or from `meters`.

    Without `corners`, the lattice of a surface that repeats regularly in two directions (tiles, bricks, a weave) is
    detected and straightened. The result contains as many complete cells of the lattice as the photo, so it tiles along
    both axes.

    With `meters`, the size of a pixel is stored in the metadata (XResolution, YResolution, ResolutionUnit), which all
    filters preserve. Stored values are filtered without conversion, and vectors in normal maps are not rotated.

    Parameters
    ----------
    source : ImageLike
        Photo to rectify.
    corners : float | Sequence[float] | None, default None
        Corners as x,y of top left, top right, bottom right, bottom left, relative to the display
        window. Expected: a number or a sequence of numbers in px. Default: detected from the photo's
        lattice.
    size : tuple[int, int] | None, default None
        Size of the result. Expected: (width, height) from 1 to 65536 px. Default: lengths of the longer
        sides in the photo.
    meters : float | Sequence[float] | None, default None
        Width and height, in meters, of the area between `corners`; without `corners`, of one cell of
        the lattice, such as a brick or a tile. Expected: a number or a sequence of numbers from 1e-09
        to 1000000000 m.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - rectified: Surface seen from the front, in the photo's color space and type. [pixels]
        - st: Source coordinates of every pixel, with subpixel precision, for `st_warp`. [32-bit float
          coordinates; with st]
        - facts: Corners, size, cells, meters and matrix. [JSON; with facts]

    Other Parameters
    ----------------
    filter : Literal['lanczos3', 'mitchell', 'triangle'], default 'lanczos3'
        Resampling filter.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that
        file.
    facts : FileName | None, default None
        JSON file for corners, size, cells, meters and the matrix.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> front = filters.rectify("photo.png", corners=(3, 2, 66, 5, 70, 60, 1, 62))
    """
@overload
def rectify(
    source: ImageLike,
    /,
    *,
    corners: float | Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    meters: float | Sequence[float] | None = None,
    filter: Literal['lanczos3', 'mitchell', 'triangle'] = 'lanczos3',
    st: Literal[True],
    facts: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def rectify(
    source: ImageLike,
    /,
    *,
    corners: float | Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    meters: float | Sequence[float] | None = None,
    filter: Literal['lanczos3', 'mitchell', 'triangle'] = 'lanczos3',
    st: bool | FileName = False,
    facts: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def rectify(
    source: ImageLike,
    /,
    *,
    corners: float | Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    meters: float | Sequence[float] | None = None,
    filter: Literal['lanczos3', 'mitchell', 'triangle'] = 'lanczos3',
    st: bool | FileName = False,
    facts: FileName | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def sheet(
    exemplar: ImageLike,
    /,
    *,
    op: Literal['stationarize', 'patchmatch', 'quilt', 'cut', 'synth', 'composite'] = 'stationarize',
    count: int = 4,
    seed: int = 0,
    vary: str | None = None,
    over: Sequence[str] | None = None,
    panel: int = 256,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Compare results of a synthesis filter in a contact sheet, with a column for each seed.

    Use it to choose a seed, or to see the effect of a modifier: `vary=sigma:over=8,16,32` makes three rows of
    `stationarize`. All other modifiers have their defaults. Captions show the modifiers of each result. The result is
    an 8-bit sRGB image for display, not for measurement.

    Parameters
    ----------
    exemplar : ImageLike
        Photo; for op=composite, with label maps.
    op : Literal['stationarize', 'patchmatch', 'quilt', 'cut', 'synth', 'composite'], default 'stationarize'
        Name of the synthesis filter.
    count : int, default 4
        Number of seeds, one for each column. Expected: an integer from 1 to 16.
    seed : int, default 0
        First seed. Expected: an integer from 0 to 4294967279.
    vary : str | None, default None
        Name of a modifier that varies from row to row. Requires over.
    over : Sequence[str] | None, default None
        Values of the modifier that vary names, one for each row.
    panel : int, default 256
        Maximum longer side of a result in the sheet. Expected: an integer from 32 to 2048 px.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - view: Contact sheet. [8-bit sRGB picture]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> sheet = filters.sheet("photo.png", op="quilt", count=3)
    """
@overload
def sheet(
    exemplar: ImageLike,
    /,
    *,
    op: Literal['stationarize', 'patchmatch', 'quilt', 'cut', 'synth', 'composite'] = 'stationarize',
    count: int = 4,
    seed: int = 0,
    vary: str | None = None,
    over: Sequence[str] | None = None,
    panel: int = 256,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
def sigmas(
    exemplar: ImageLike,
    /,
    *,
    count: int = 9,
    tilesize: tuple[int, int] | None = None,
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    seed: int = 0,
    columns: int = 3,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Compare the effect of sigma in `stationarize` on a photo, as a contact sheet with equal visible steps.

    The sheet shows small tiles, each repeated 2 x 2, from the largest sigma (evenness 0) to the smallest (evenness 1).
    The visible effect of sigma depends on the photo: it is measured as the earth mover's distance between the
    histograms of neighboring tiles, and sigmas are spaced to make these steps equal (MJH17: Moritz, James, Haines,
    Ritschel, Weyrich, Texture Stationarization, Eurographics 2017, section 4.4).

    `evenness` of `stationarize` uses the same scale, which is stored in the user's cache. The table of sigmas
    is printed, and written with `facts`. The result is an 8-bit sRGB image for display, not for measurement.

    Parameters
    ----------
    exemplar : ImageLike
        Photo.
    count : int, default 9
        Number of sigmas. Expected: an integer from 3 to 32.
    tilesize : tuple[int, int] | None, default None
        Size of the final tile, for which the sigmas are computed. The sheet itself shows small tiles.
        Expected: (width, height) from 5 to 65536 px. Default: size of the photo.
    seed : int, default 0
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295.
    columns : int, default 3
        Number of tiles in a row. Expected: an integer from 1 to 32.
    facts : FileName | None, default None
        JSON file for the table.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - view: Contact sheet. [8-bit sRGB picture]
        - facts: Table of sigmas and their evenness. [JSON; with facts]

    Other Parameters
    ----------------
    measure : Literal['histogram', 'moments', 'steerable'], default 'histogram'
        Statistics that define stationarity. histogram: local histograms. moments: local moments.
        steerable: responses of steerable filters.
    order : int | None, default None
        Highest order of moments, for measure=moments. 2: mean and variance. 3: also skewness. 4: also
        kurtosis. Expected: an integer from 2 to 4. Default: 2.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> sheet = filters.sigmas("photo.png", count=4)
    """
@overload
def sigmas(
    exemplar: ImageLike,
    /,
    *,
    count: int = 9,
    tilesize: tuple[int, int] | None = None,
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    seed: int = 0,
    columns: int = 3,
    facts: FileName | None = None,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
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
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Map the stationarity of an image: how much each place differs statistically from the rest.

    The value of a pixel is the mean difference between local statistics there, in a Gaussian window of scale sigma, and
    those elsewhere: near 0 in typical areas, high in stains, shadows and unusual patches. Depending on `measure`, the
    difference is the earth mover's distance between Lab histograms or between histograms of steerable filter responses,
    or the squared difference of local moments.

    The mean of the map is the stationarity cost of MJH17, eq. 1 (Moritz, James, Haines, Ritschel, Weyrich, Texture
    Stationarization, Eurographics 2017). It is logged with -v and stored in the attribute oiiotex:stationarity of
    the result.

    Parameters
    ----------
    source : ImageLike
        Image to measure.
    sigma : float | None, default None
        Scale of the local statistics. Expected: a number from 1 to 1000000 px. Default: longer side /
        32.
    measure : Literal['histogram', 'moments', 'steerable'], default 'histogram'
        Statistics that define stationarity. histogram: local histograms. moments: local moments.
        steerable: responses of steerable filters.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - deviation: One channel in Lab units (for moments, squared), in the image's windows. [32-bit
          float values]

    Other Parameters
    ----------------
    order : int | None, default None
        Highest order of moments, for measure=moments. 2: mean and variance. 3: also skewness. 4: also
        kurtosis. Expected: an integer from 2 to 4. Default: 2.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> deviation = filters.stationarity("photo.png")
    >>> worst = deviation.get_pixels().max()  # Lab units
    """
@overload
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
    as_array: Literal[True],
) -> Array: ...

@overload
def stationarize(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    weightmap: ImageLike | None = None,
    sigmamap: ImageLike | None = None,
    flattening: float | None = None,
    drift: FileName | Literal[False] = False,
    sigma: float | None = None,
    evenness: float | None = None,
    histogram: float | None = None,
    target: Literal['flat', 'exemplar'] = 'flat',
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    lattice: float = 0.5,
    preset: Literal['even', 'clean', 'large'] | None = None,
    paper: bool = False,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    variants: Literal[1] = 1,
    pack: Literal['atlas'] | None = None,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    equaluse: float = 0.01,
    repeatpenalty: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: FileName | Literal[False] = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Create a seamlessly tiling texture from a photo, without visible repetition.

    Gradients of light and stains repeat visibly when a photo is tiled, so `flattening` removes them first. The photo is
    then resynthesized from its own patches while local statistics (by default histograms) are kept uniform above a
    scale sigma (MJH17: Moritz, James, Haines, Ritschel, Weyrich, Texture Stationarization, Eurographics 2017).

    Every pixel of the result is a copy of one pixel of the photo, with all its channels. Where low-frequency variation
    was removed, a gain and an offset in Lab are applied to the copy. With `relevel`, a constant is also added to each
    copied piece of a height map.

    Parameters
    ----------
    exemplar : ImageLike
        Photo; of the maps of a material, the first.
    mask : ImageLike | None, default None
        Image that marks the valid source pixels (first channel above half its range, or a nonzero label
        id). A string is the name of a part of the first image, or a file name.
    sigmamap : ImageLike | None, default None
        Float image of the result's size whose first channel is sigma, in pixels, at each pixel. Use it
        to keep structure in some areas and even out others. A string is the name of a part of the first
        image, or a file name.
    maps : Sequence[ImageLike], default ()
        Further maps, resynthesized from the same source pixels. A string is the name of a part of the
        first image, or a file name.
    flattening : float | None, default None
        Fraction of the photo's gradients and stains to remove before synthesis. 0: every pixel is a
        verbatim copy. Expected: a number from 0 to 1. Default: 1; for data, 0.
    sigma : float | None, default None
        Scale, in pixels, above which the result is statistically uniform. Smaller structures are kept.
        Reduce it if features still repeat visibly. Expected: a number from 0.5 to 1000000 px. Default:
        longer side / 8, at least patch / 4.
    lattice : float, default 0.5
        Strength with which regular repeats (tiles, courses, weaves) are preserved. If the photo's size
        does not hold complete repeats, the result gets the nearest size that does, unless size is set.
        0: repeats are not preserved. No effect on photos without regular repeats. Expected: a number
        from 0 to 1.
    preset : Literal['even', 'clean', 'large'] | None, default None
        Values for modifiers that you do not set. large: large structures are preserved (sigma = longer
        side / 4, patch=21). even: large structures are also evened out (sigma = longer side / 32,
        patch=11). clean: objects are also removed (as even, with histogram=0 and a mask from
        `dominant`).
    size : Literal['pow2'] | tuple[int, int] | None, default None
        Size of the result. pow2: each side of the photo, rounded to the nearest power of two. Expected:
        'pow2' or (width, height) from 5 to 65536 px. Default: size of the photo.
    tiles : Literal['none', 'x', 'y', 'xy'], default 'xy'
        Axes along which the result tiles.
    variants : int, default 1
        Number of interchangeable tiles. 2 to 7: any tile fits next to any other. 8 or more: Wang tiles,
        which fit where edge colors agree; 16 or more are a complete set with two corner colors. Part
        names and the attribute oiiotex:edges contain the edge colors. Expected: an integer from 1 to
        64.
    pack : Literal['atlas'] | None, default None
        Arrangement of the tiles. atlas: one image in which neighbors share an edge, also across its
        borders, so that renderers can filter it without padding. Requires variants=4, 16 or 64.
        Default: one image for each tile.
    patch : Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None, default None
        Side of a patch, in pixels. Structures up to this size are copied whole. Increase it if bricks
        or stones are cut. Expected: one of 5, 7, 9, 11, 13, 15, 17, 19, 21. Default: 13.
    kinds : Sequence[str] | None, default None
        Kind of each map of a material: color, data, normal or height. The last images on the stack are
        used, one for each kind, in order. Maps other than color are tagged as data in the result.
        Default: one map: color; with data=1, data.
    label : int | None, default None
        Id of a label in the exemplar's label maps. Only pixels of that label are used as a source.
        Expected: an integer >= 1.
    seed : int, default 0
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]
        A dict of parts by name if more than one part is requested.
        A list of these if several images are made.
        - tile: Pixels copied from the photo, all channels together, in its color space and type. One
          image for each of the maps, in order, and for each variant. [pixels]
        - st: Source coordinates of every pixel, for `warp` and `st_warp`. [32-bit float coordinates;
          with st]
        - report: Measures of the result, for programs. [JSON; with report]
        - drift: Correction: Lab x gain + offset. Channels: gain.L, gain.a, gain.b, offset.L, offset.a,
          offset.b. [32-bit float values; with drift]

    Other Parameters
    ----------------
    labels : ImageLike | None, default None
        Label maps of the exemplar, if they are not stored as its parts. A string is the name of a part
        of the first image, or a file name.
    weightmap : ImageLike | None, default None
        Image of relative weights, in its first channel: pixels of weight 2 are used twice as often as
        pixels of weight 1, and pixels of weight 0 are never used. A string is the name of a part of the
        first image, or a file name.
    drift : bool | FileName, default False
        Correction that removes gradients and stains. 1: append it as part 'drift'; a file name: write
        it to that file.
    evenness : float | None, default None
        Visible uniformity of the result, from 0 (least) to 1 (most), used instead of sigma. Equal steps
        make equally visible differences; `sigmas` shows them for a photo. Expected: a number from 0 to
        1.
    histogram : float | None, default None
        Strength with which the overall colors of the result are matched to the histogram of `target`.
        Increase it if rare colors are missing. At 0, the colors of rare objects, such as windows in a
        wall, may vanish. Expected: a number from 0 to 1. Default: 0.7.
    target : Literal['flat', 'exemplar'], default 'flat'
        Histogram that `histogram` matches. flat: that of the photo after evening out. exemplar: that of
        the photo as it is, matched only on the coarsest level, as in the paper.
    measure : Literal['histogram', 'moments', 'steerable'], default 'histogram'
        Statistics that define stationarity. histogram: local histograms. moments: local moments.
        steerable: responses of steerable filters.
    order : int | None, default None
        Highest order of moments, for measure=moments. 2: mean and variance. 3: also skewness. 4: also
        kurtosis. Expected: an integer from 2 to 4. Default: 2.
    paper : bool, default False
        Settings of the paper (MJH17), for comparison:
        flattening=0:target=exemplar:histogram=1:lattice=0, sigma = longer side / 32, patch=11, no reuse
        penalties, and the paper's pyramid and iterations.
    relevel : bool, default False
        Raise or lower each copied piece of a height map so that pieces meet without steps. Set it if
        displaced heights show cliffs. Requires kinds=...,height.
    iterations : int, default 30
        Number of iterations on the coarsest level. Each finer level has one. Increase it if a warning
        says that texture is lost. Expected: an integer from 1 to 1000.
    equaluse : float, default 0.01
        Strength with which all parts of the photo are used equally often (MJH17 eq. 6). Increase it to
        use more of the photo. Above 0.1, structures break up. Expected: a number from 0 to 1.
    repeatpenalty : float, default 1.0
        Weight of the penalty for regions of the photo that are used more than twice. At 0, the result
        is closer to the photo and repeats more. Expected: a number from 0 to 1.
    resume : bool, default False
        Save a checkpoint after each pyramid level next to the output, in the folder OUTPUT.parts. Run
        the same command again to resume.
    report : FileName | None, default None
        JSON file for the measures of the result (see docs/reference/report.md).
    fail : Sequence[str] | None, default None
        Conditions that count as failure, such as fidelity<0.8,seam>1.5. If one is true, the result is
        still written, but the exit code is 3.
    mapweights : float | Sequence[float] | None, default None
        Weight of each map in the comparison of patches, in order. 0: the map is not compared, but
        follows the others. Expected: a number or a sequence of numbers >= 0. Default: 1 for each map,
        0.25 for a height.
    labellevel : int | None, default None
        Level of the label maps: N selects the part label.N. 1 is the finest. Expected: an integer >= 1.
        Default: the coarsest with several labels.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as part 'st'; a file name: write them to that
        file.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> tile = filters.stationarize("photo.png", preset="large", seed=7)
    >>> tile.write("tile.png")
    True
    """
@overload
def stationarize(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    weightmap: ImageLike | None = None,
    sigmamap: ImageLike | None = None,
    flattening: float | None = None,
    drift: Literal[True],
    sigma: float | None = None,
    evenness: float | None = None,
    histogram: float | None = None,
    target: Literal['flat', 'exemplar'] = 'flat',
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    lattice: float = 0.5,
    preset: Literal['even', 'clean', 'large'] | None = None,
    paper: bool = False,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    variants: Literal[1] = 1,
    pack: Literal['atlas'] | None = None,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    equaluse: float = 0.01,
    repeatpenalty: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def stationarize(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    weightmap: ImageLike | None = None,
    sigmamap: ImageLike | None = None,
    flattening: float | None = None,
    drift: bool | FileName = False,
    sigma: float | None = None,
    evenness: float | None = None,
    histogram: float | None = None,
    target: Literal['flat', 'exemplar'] = 'flat',
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    lattice: float = 0.5,
    preset: Literal['even', 'clean', 'large'] | None = None,
    paper: bool = False,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    variants: Literal[1] = 1,
    pack: Literal['atlas'] | None = None,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    equaluse: float = 0.01,
    repeatpenalty: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: Literal[True],
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def stationarize(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    weightmap: ImageLike | None = None,
    sigmamap: ImageLike | None = None,
    maps: Sequence[ImageLike] = (),
    flattening: float | None = None,
    drift: bool | FileName = False,
    sigma: float | None = None,
    evenness: float | None = None,
    histogram: float | None = None,
    target: Literal['flat', 'exemplar'] = 'flat',
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    lattice: float = 0.5,
    preset: Literal['even', 'clean', 'large'] | None = None,
    paper: bool = False,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    variants: int = 1,
    pack: Literal['atlas'] | None = None,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    equaluse: float = 0.01,
    repeatpenalty: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf] | list[ImageBuf] | list[dict[str, ImageBuf]]: ...
@overload
def stationarize(
    exemplar: ImageLike,
    /,
    *,
    mask: ImageLike | None = None,
    labels: ImageLike | None = None,
    weightmap: ImageLike | None = None,
    sigmamap: ImageLike | None = None,
    maps: Sequence[ImageLike] = (),
    flattening: float | None = None,
    drift: bool | FileName = False,
    sigma: float | None = None,
    evenness: float | None = None,
    histogram: float | None = None,
    target: Literal['flat', 'exemplar'] = 'flat',
    measure: Literal['histogram', 'moments', 'steerable'] = 'histogram',
    order: int | None = None,
    lattice: float = 0.5,
    preset: Literal['even', 'clean', 'large'] | None = None,
    paper: bool = False,
    relevel: bool = False,
    size: Literal['pow2'] | tuple[int, int] | None = None,
    tiles: Literal['none', 'x', 'y', 'xy'] = 'xy',
    variants: int = 1,
    pack: Literal['atlas'] | None = None,
    patch: Literal[5, 7, 9, 11, 13, 15, 17, 19, 21] | None = None,
    iterations: int = 30,
    equaluse: float = 0.01,
    repeatpenalty: float = 1.0,
    resume: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    mapweights: float | Sequence[float] | None = None,
    label: int | None = None,
    labellevel: int | None = None,
    data: bool = False,
    seed: int = 0,
    st: bool | FileName = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def superpixel(
    source: Picture,
    /,
    *,
    sigma: float | None = None,
    count: int | None = None,
    sigmamin: float | None = None,
    compactness: float = 20.0,
    photo: Literal[False] = False,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Segment an image into superpixels: small connected regions of similar color.

    Fine superpixels are computed by SLIC in Lab. They are merged into coarser ones by their blurred colors, so
    every coarse border is also a fine border (LSA16: Lockerman, Sauvage, Allegre, Dischler, Dorsey, Rushmeier,
    Multi-Scale Label-Map Extraction for Texture Synthesis, SIGGRAPH 2016, section 3).

    The result is a label map. Ids start at 1, in the order of their first pixels; transparent pixels have id 0. The
    result does not depend on the memory budget.

    Parameters
    ----------
    source : ImageLike
        Image to segment.
    sigma : float | None, default None
        Scale of the superpixels, rounded to the nearest level. Increase it for larger superpixels.
        Expected: a number from 1 to 1000000 px. Default: the finest level.
    count : int | None, default None
        Number of superpixels, used instead of sigma. Expected: an integer >= 1.
    sigmamin : float | None, default None
        Scale of the smallest superpixels, from which coarser ones are merged. Reduce it if thin details
        are lost. Expected: a number from 2 to 100000 px. Default: shorter side / 50, at least 4.
    compactness : float, default 20.0
        Compactness m of SLIC: the Lab distance that weighs as much as one sigma in space. Increase it
        for rounder superpixels. Expected: a number from 0.1 to 100.
    photo : bool, default False
        Keep the image as the first part, followed by the label map.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - photo: Photo, as the first part. [pixels; with photo]
        - superpixels: One channel of ids, in the image's windows. Write it to EXR or TIFF. [32-bit ids]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> ids = filters.superpixel("photo.png", count=100)
    >>> view = filters.labelview(ids)
    """
@overload
def superpixel(
    source: ImageLike,
    /,
    *,
    sigma: float | None = None,
    count: int | None = None,
    sigmamin: float | None = None,
    compactness: float = 20.0,
    photo: Literal[True],
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def superpixel(
    source: ImageLike,
    /,
    *,
    sigma: float | None = None,
    count: int | None = None,
    sigmamin: float | None = None,
    compactness: float = 20.0,
    photo: bool = False,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def superpixel(
    source: ImageLike,
    /,
    *,
    sigma: float | None = None,
    count: int | None = None,
    sigmamin: float | None = None,
    compactness: float = 20.0,
    photo: bool = False,
    data: bool = False,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def synth(
    exemplar: ImageLike | None = None,
    /,
    *,
    size: tuple[int, int] | None = None,
    window: str | None = None,
    lod: int | None = None,
    tiles: Literal['none', 'xy'] = 'none',
    resume: bool = False,
    st: FileName | Literal[False] = False,
    graph: FileName | None = None,
    keeplayout: bool | int = False,
    jitter: float | Sequence[float] | None = None,
    matchcolor: bool = True,
    exemplarside: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    paper: bool = False,
    seed: int | None = None,
    data: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Synthesize an unbounded texture from one exemplar, or from a graph of exemplars at different scales.

    Without `graph`, a texture of any size is synthesized from the top image (Lefebvre & Hoppe, Parallel controllable
    texture synthesis, 2005). With `graph`, several small exemplars at different scales are combined. Any window at any
    level of detail can be computed alone, and has the same pixels as in the whole texture (HRRG08: Han, Risser,
    Ramamoorthi, Grinspun, Multiscale Texture Synthesis, 2008).

    Exemplars are cropped to centered squares with a power-of-two side. One that does not tile is mirrored at its
    borders. Every pixel is a copy of an exemplar's pixel, plus a color offset where exemplars of a graph differ.

    Parameters
    ----------
    exemplar : ImageLike | None
        Exemplar. Omit it with graph.
    size : tuple[int, int] | None, default None
        Size of the result. Expected: (width, height) from 1 to 1073741824 px. Default: size of window,
        otherwise of the exemplar.
    window : str | None, default None
        Window of the unbounded plane to compute, as WxH+X+Y.
    lod : int | None, default None
        Resolution. At level N, the root exemplar (without `graph`, the photo) is 2^N pixels wide.
        Reduce it for a preview. Expected: an integer from 0 to 60. Default: finest level of the
        exemplars.
    tiles : Literal['none', 'xy'], default 'none'
        Axes along which the result tiles. xy requires size, with sides that are multiples of 2^level
        pixels.
    graph : FileName | None, default None
        Exemplar graph (JSON or YAML), as the graph filter writes it: photos at several scales, and
        which one refines which.
    exemplarside : Literal[16, 32, 64, 128, 256, 512, 1024], default 256
        Maximum side of the square that is cropped from an exemplar. Expected: one of 16, 32, 64, 128,
        256, 512, 1024.
    seed : int | None, default None
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295. Default: seed of the graph, else 0.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    lattice : float, default 0.5
        Strength with which regular repeats (tiles, courses, weaves) are preserved. If the photo's size
        does not hold complete repeats, the result gets the nearest size that does, unless size is set.
        0: repeats are not preserved. No effect on photos without regular repeats. Expected: a number
        from 0 to 1.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf | dict[str, ImageBuf]
        A dict of parts by name if more than one part is requested.
        - texture: Pixels copied from the exemplars, all channels, in the root's color space and type.
          [pixels]
        - st: Source coordinates of every pixel, for `warp`; with graph, also the exemplar's number.
          [32-bit float coordinates; with st]
        - transfer: Color offset added to each copied pixel: L, a and b of CIE Lab in R, G and B. Only
          with graph. [32-bit float coordinates; with st]
        - report: Measures of the result, for programs. [JSON; with report]

    Other Parameters
    ----------------
    resume : bool, default False
        Save a checkpoint after each finished piece next to the output, in the folder OUTPUT.parts. Run
        the same command again to resume.
    st : bool | FileName, default False
        Source coordinates of every pixel. 1: append them as parts; a file name: write them to that
        file.
    keeplayout : bool | int, default False
        Layout of the root exemplar that is kept, so that only finer detail is random. 0: nothing is
        kept. 1: up to the root's resolution. 2 to 60: up to that level. Expected: True, False, or an
        integer from 0 to 60.
    jitter : float | Sequence[float] | None, default None
        Randomness of each level, from level 0 on (HRRG08 section 4.3). The last number applies to all
        further levels. Reduce it where structures break, increase it where the exemplar repeats.
        Expected: a number or a sequence of numbers from 0 to 1. Default: that of the graph, else 1 on
        coarse levels, 0.6 on further ones, and 0 on the root's two finest; 0.6 on all levels of an
        endless zoom and with paper.
    matchcolor : bool, default True
        Correction of color differences between the exemplars of a graph (HRRG08 section 5). Set it to 0
        for verbatim colors.
    paper : bool, default False
        Settings of the paper (HRRG08): 6 principal components instead of 16, jitter on all levels, and
        without the corrections that preserve contrast in endless zooms.
    report : FileName | None, default None
        JSON file for the measures of the result (see docs/reference/report.md).
    fail : Sequence[str] | None, default None
        Conditions that count as failure, such as fidelity<0.8,seam>1.5. If one is true, the result is
        still written, but the exit code is 3.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> texture = filters.synth("photo.png", size=(1024, 512), seed=7)
    """
@overload
def synth(
    exemplar: ImageLike | None = None,
    /,
    *,
    size: tuple[int, int] | None = None,
    window: str | None = None,
    lod: int | None = None,
    tiles: Literal['none', 'xy'] = 'none',
    resume: bool = False,
    st: Literal[True],
    graph: FileName | None = None,
    keeplayout: bool | int = False,
    jitter: float | Sequence[float] | None = None,
    matchcolor: bool = True,
    exemplarside: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    paper: bool = False,
    seed: int | None = None,
    data: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> dict[str, ImageBuf]: ...
@overload
def synth(
    exemplar: ImageLike | None = None,
    /,
    *,
    size: tuple[int, int] | None = None,
    window: str | None = None,
    lod: int | None = None,
    tiles: Literal['none', 'xy'] = 'none',
    resume: bool = False,
    st: bool | FileName = False,
    graph: FileName | None = None,
    keeplayout: bool | int = False,
    jitter: float | Sequence[float] | None = None,
    matchcolor: bool = True,
    exemplarside: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    paper: bool = False,
    seed: int | None = None,
    data: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf | dict[str, ImageBuf]: ...
@overload
def synth(
    exemplar: ImageLike | None = None,
    /,
    *,
    size: tuple[int, int] | None = None,
    window: str | None = None,
    lod: int | None = None,
    tiles: Literal['none', 'xy'] = 'none',
    resume: bool = False,
    st: bool | FileName = False,
    graph: FileName | None = None,
    keeplayout: bool | int = False,
    jitter: float | Sequence[float] | None = None,
    matchcolor: bool = True,
    exemplarside: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    paper: bool = False,
    seed: int | None = None,
    data: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    lattice: float = 0.5,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array | Any: ...

@overload
def warp(
    source: ImageLike,
    stmap: ImageLike,
    /,
    *,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Rearrange the pixels of an image by a map of source coordinates, without interpolation.

    Use it to apply a synthesis to further maps of a photo: for example, the photo's normal map and the `stmap` of its
    tile give the normal map of the tile. The result has the size of the map. Pixels are copied unchanged, so normals
    remain valid. The image must have the display window of the photo from which the map was made.

    Parameters
    ----------
    source : ImageLike
        Image that provides the pixels.
    stmap : ImageLike
        Source coordinates: part 'st', or the first part if there is none of that name.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - warped: Pixels of the image, copied as the map says. [pixels]

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> made = filters.stationarize("photo.png", st=True)
    >>> rough_tile = filters.warp("roughness.png", made["st"])
    """
@overload
def warp(
    source: ImageLike,
    stmap: ImageLike,
    /,
    *,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...

@overload
def zoom(
    exemplar: ImageLike | None = None,
    /,
    *,
    frame: int | None = None,
    first: int = 1,
    speed: float = 0.05,
    lod: float | None = None,
    center: float | Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    movie: FileName | None = None,
    count: int = 48,
    fps: float = 24.0,
    graph: FileName | None = None,
    keeplayout: bool | int = False,
    jitter: float | Sequence[float] | None = None,
    matchcolor: bool = True,
    exemplarside: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    paper: bool = False,
    seed: int | None = None,
    data: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[False] = False,
) -> ImageBuf:
    """Render one frame of a zoom into an unbounded texture.

    A frame depends only on its number, which `--frames` sets, and only its visible part is synthesized (HRRG08: Han,
    Risser, Ramamoorthi, Grinspun, Multiscale Texture Synthesis, 2008, figure 3). At integer octaves, a frame is a
    window of `synth` at that level; in between, the two nearest levels are resampled and blended.

    Without `graph`, the zoom into the photo is endless: at its finest resolution, the photo continues in itself.

    Parameters
    ----------
    exemplar : ImageLike | None
        Exemplar. Omit it with graph.
    frame : int | None, default None
        Number of the frame. Default: that of --frames, otherwise first.
    first : int, default 1
        Number of the frame at which the zoom begins.
    speed : float, default 0.05
        Octaves per frame. 1 doubles the scale each frame; negative values zoom out. Expected: a number
        from -8 to 8.
    lod : float | None, default None
        Level of detail of the first frame, as in `synth`. Expected: a number from 0 to 60. Default:
        resolution of the root.
    center : float | Sequence[float] | None, default None
        Point X,Y to zoom into, in pixels of the root. Expected: a number or a sequence of numbers in
        px. Default: center of the root.
    size : tuple[int, int] | None, default None
        Size of the frame. Expected: (width, height) from 1 to 65536 px. Default: size of the root.
    movie : FileName | None, default None
        File for a preview movie: .gif (Pillow), or .mp4 (requires ffmpeg in $PATH).
    count : int, default 48
        Number of frames of the movie, from this frame on. Expected: an integer from 2 to 65536.
    fps : float, default 24.0
        Frames per second of the movie. Expected: a number from 0.1 to 240.
    graph : FileName | None, default None
        Exemplar graph (JSON or YAML), as the graph filter writes it: photos at several scales, and
        which one refines which.
    exemplarside : Literal[16, 32, 64, 128, 256, 512, 1024], default 256
        Maximum side of the square that is cropped from an exemplar. Expected: one of 16, 32, 64, 128,
        256, 512, 1024.
    seed : int | None, default None
        Seed of the random numbers. The same seed gives the same pixels. Expected: an integer from 0 to
        4294967295. Default: seed of the graph, else 0.
    data : bool, default False
        Use the channels as data, without conversion to CIE Lab.
    colorspace : str | None, default None
        Color space of the required images. Default: the one in their metadata.
    roi : ROI | None, default None
        Region of the result to compute. Default: all of it.
    nthreads : int, default 0
        Number of CPU threads if no session is given. 0: all that the process may use.
    session : Session | None, default None
        Device, memory budget, color config and progress, shared by several calls.
    as_array : bool, default False
        Return arrays of pixels instead of ImageBufs, without color space and metadata.

    Returns
    -------
    ImageBuf
        - frame: All channels, in the root's color space and type, with the display window at 0,0.
          [pixels]
        - movie: Zoom from this frame on, in sRGB. [GIF or MP4; with movie]
        - report: Measures of the result, for programs. [JSON; with report]

    Other Parameters
    ----------------
    keeplayout : bool | int, default False
        Layout of the root exemplar that is kept, so that only finer detail is random. 0: nothing is
        kept. 1: up to the root's resolution. 2 to 60: up to that level. Expected: True, False, or an
        integer from 0 to 60.
    jitter : float | Sequence[float] | None, default None
        Randomness of each level, from level 0 on (HRRG08 section 4.3). The last number applies to all
        further levels. Reduce it where structures break, increase it where the exemplar repeats.
        Expected: a number or a sequence of numbers from 0 to 1. Default: that of the graph, else 1 on
        coarse levels, 0.6 on further ones, and 0 on the root's two finest; 0.6 on all levels of an
        endless zoom and with paper.
    matchcolor : bool, default True
        Correction of color differences between the exemplars of a graph (HRRG08 section 5). Set it to 0
        for verbatim colors.
    paper : bool, default False
        Settings of the paper (HRRG08): 6 principal components instead of 16, jitter on all levels, and
        without the corrections that preserve contrast in endless zooms.
    report : FileName | None, default None
        JSON file for the measures of the result (see docs/reference/report.md).
    fail : Sequence[str] | None, default None
        Conditions that count as failure, such as fidelity<0.8,seam>1.5. If one is true, the result is
        still written, but the exit code is 3.

    Raises
    ------
    oiiotex.Error
        With the problem, the expected value and a hint, in one line.

    Examples
    --------
    >>> from oiiotex import filters
    >>> frames = [filters.zoom("photo.png", frame=n, size=(640, 360)) for n in (1, 2)]
    """
@overload
def zoom(
    exemplar: ImageLike | None = None,
    /,
    *,
    frame: int | None = None,
    first: int = 1,
    speed: float = 0.05,
    lod: float | None = None,
    center: float | Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    movie: FileName | None = None,
    count: int = 48,
    fps: float = 24.0,
    graph: FileName | None = None,
    keeplayout: bool | int = False,
    jitter: float | Sequence[float] | None = None,
    matchcolor: bool = True,
    exemplarside: Literal[16, 32, 64, 128, 256, 512, 1024] = 256,
    paper: bool = False,
    seed: int | None = None,
    data: bool = False,
    report: FileName | None = None,
    fail: Sequence[str] | None = None,
    colorspace: str | None = None,
    roi: ROI | None = None,
    nthreads: int = 0,
    session: Session | None = None,
    as_array: Literal[True],
) -> Array: ...
