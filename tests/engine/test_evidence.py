# SPDX-License-Identifier: Apache-2.0
"""Colors are what the file says: profiles, CICP, chromaticities and Exif win over a tag that a reader assumes."""

import shlex
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import PyOpenColorIO as ocio
import pytest
from PIL import Image, ImageCms

from oiiotex import filters
from oiiotex.engine.color.config import ColorConfig, space_of
from oiiotex.engine.errors import ColorError, Error
from oiiotex.engine.io.icc import of_cicp, of_profile
from oiiotex.engine.io.reading import read
from oiiotex.oiiotool.cli.running.line_run import run

D50 = (0.9642, 1.0, 0.8249)
ADOBE = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
P3 = ((0.51512, 0.24120, -0.00105), (0.29198, 0.69225, 0.04189), (0.15710, 0.06657, 0.78407))
PROPHOTO = ((0.79767, 0.28804, 0.0), (0.13519, 0.71188, 0.0), (0.03134, 0.00009, 0.82491))
SRGB = ((0.43607, 0.22249, 0.01392), (0.38515, 0.71687, 0.09708), (0.14307, 0.06061, 0.71410))
SRGB_CURVE = (3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)


def number(value: float) -> bytes:
    return struct.pack(">i", round(value * 65536))


def curve(gamma: float | tuple[float, ...] | np.ndarray) -> bytes:
    """A gamma, a parametric curve (its type first), or samples."""
    if isinstance(gamma, tuple):
        return b"para" + bytes(4) + struct.pack(">HH", gamma[0], 0) + b"".join(map(number, gamma[1:]))
    samples = [round(gamma * 256)] if isinstance(gamma, float) else np.rint(gamma * 65535).astype(int).tolist()
    return b"curv" + bytes(4) + struct.pack(f">I{len(samples)}H", len(samples), *samples)


def profile(
    name: str, primaries: tuple[tuple[float, ...], ...], gamma: float | tuple[float, ...] | np.ndarray
) -> bytes:
    """A profile of a matrix and curves; of one gray curve without primaries."""
    text = name.encode("utf-16-be")
    tags = {
        b"desc": b"mluc" + bytes(4) + struct.pack(">II", 1, 12) + b"enUS" + struct.pack(">II", len(text), 28) + text,
        b"wtpt": b"XYZ " + bytes(4) + b"".join(map(number, D50)),
        b"cprt": b"text" + bytes(4) + b"none\0",
    }
    for letter, column in zip(b"rgb", primaries, strict=False):
        tags[bytes([letter]) + b"XYZ"] = b"XYZ " + bytes(4) + b"".join(map(number, column))
        tags[bytes([letter]) + b"TRC"] = curve(gamma)
    if not primaries:
        tags[b"kTRC"] = curve(gamma)
    table, data, start = struct.pack(">I", len(tags)), b"", 132 + 12 * len(tags)
    for key, value in tags.items():
        padded = value + bytes(-len(value) % 4)
        table, data = table + struct.pack(">4sII", key, start + len(data), len(value)), data + padded
    head = bytearray(128)
    head[8:12], head[12:24] = b"\4\x30\0\0", b"mntr" + (b"RGB " if primaries else b"GRAY") + b"XYZ "
    head[24:36], head[36:40] = struct.pack(">6H", 2020, 1, 1, 0, 0, 0), b"acsp"
    head[68:80], head[0:4] = b"".join(map(number, D50)), struct.pack(">I", start + len(data))
    return bytes(head) + table + data


PROFILES = {
    "adobe": (profile("Adobe RGB (1998)", ADOBE, 2.19921875), "g22_adobergb_scene"),
    "camera": (profile("Camera 7 RGB", ADOBE, 2.2), "g22_adobergb_scene"),
    "p3": (profile("Display P3", P3, SRGB_CURVE), "srgb_p3d65_scene"),
    "p3 of gamma 2.2": (profile("Display P3", P3, 2.2), "srgb_p3d65_scene"),
    "unnamed p3": (profile("x", P3, SRGB_CURVE), "srgb_p3d65_scene"),
    "table": (profile("x", ADOBE, np.linspace(0, 1, 1024) ** 2.2), "g22_adobergb_scene"),
    "linear": (profile("x", SRGB, 1.0), "lin_rec709_scene"),
    "srgb": (profile("sRGB", SRGB, SRGB_CURVE), "srgb_rec709_scene"),
    "gamma 1.8": (profile("x", SRGB, 1.8), "g18_rec709_scene"),
}
CONFIG = ColorConfig()


def photo(channels: int = 3) -> np.ndarray:
    shape = (40, 56, channels) if channels > 1 else (40, 56)
    return (np.random.default_rng(2).random(shape) * 200 + 20).astype(np.uint8)


def saved(path: Path, embedded: bytes | None, channels: int = 3, **more: object) -> Path:
    """An image that Pillow writes."""
    words = {} if embedded is None else {"icc_profile": embedded}
    Image.fromarray(photo(channels)).save(path, **words, **more)
    return path


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif", "webp"])
@pytest.mark.parametrize("kind", PROFILES)
def test_a_profile_is_mapped_to_the_space_with_its_colors(tmp_path, kind, suffix):
    embedded, space = PROFILES[kind]
    path = saved(tmp_path / f"a.{suffix}", embedded)
    assert CONFIG.same(space_of(read(path), CONFIG), space)
    made = filters.flatten(str(path))
    assert CONFIG.same(made.spec().get_string_attribute("oiio:ColorSpace"), space)


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif", "webp"])
def test_another_profile_is_refused_by_name(tmp_path, suffix):
    path = saved(tmp_path / f"a.{suffix}", profile("ProPhoto RGB", PROPHOTO, 1.8))
    expected = r"has the ICC profile 'ProPhoto RGB', which matches no color space of .+; add --iscolorspace"
    for line in ("--texflatten", "--tocolorspace ACEScg"):
        with pytest.raises(Error, match=r"the ICC profile 'ProPhoto RGB'.*--iscolorspace") as error:
            run(shlex.split(f"--noprogress {path.name} {line} -o o.exr"), tmp_path)
        assert "\n" not in str(error.value)
    with pytest.raises(ColorError, match=expected.split(";")[0]):
        filters.flatten(str(path))
    assert run(shlex.split(f"--noprogress {path.name} --iscolorspace ACEScg --texflatten -o o.exr"), tmp_path) == 0
    assert run(shlex.split(f"{path.name} --resize 20x20 -o plain.exr"), tmp_path) == 0


def test_a_space_of_the_users_config_matches_by_its_colors(tmp_path):
    """ProPhoto RGB under another name: D50 adapted to D65, and a gamma of 1.8."""
    to_d65 = np.array([[0.9555766, -0.0230393, 0.0631636], [-0.0282895, 1.0099416, 0.0210077],
                       [0.0122982, -0.0204830, 1.3299098]])  # fmt: skip
    matrix = np.eye(4)
    matrix[:3, :3] = to_d65 @ np.array(PROPHOTO).T
    config = ocio.Config()
    config.setVersion(2, 1)
    group = ocio.GroupTransform(
        [ocio.ExponentTransform([1.8, 1.8, 1.8, 1]), ocio.MatrixTransform(matrix.ravel().tolist())]
    )
    scene = ocio.REFERENCE_SPACE_SCENE
    config.addColorSpace(ocio.ColorSpace(scene, "xyz"))
    config.addColorSpace(ocio.ColorSpace(scene, "our camera", toReference=group))
    (tmp_path / "own.ocio").write_text(config.serialize())
    path = saved(tmp_path / "a.png", profile("ProPhoto RGB", PROPHOTO, 1.8))
    own = ColorConfig(str(tmp_path / "own.ocio"), ("xyz", "CIE XYZ D65"))
    assert space_of(read(path), own) == "our camera"


def test_a_gray_profile_describes_a_gray_image(tmp_path):
    path = saved(tmp_path / "a.png", profile("Gray Gamma 2.2", (), 2.2), channels=1)
    assert CONFIG.same(space_of(read(path), CONFIG), "g22_rec709_scene")


def test_curves_and_matrices_are_those_of_littlecms():
    """The oracle: Pillow's LittleCMS, from the profile to its own sRGB."""
    values = np.random.default_rng(5).integers(30, 226, (8, 8, 3), np.uint8)
    srgb = ImageCms.createProfile("sRGB")
    target = of_profile(ImageCms.ImageCmsProfile(srgb).tobytes())
    for embedded, _ in PROFILES.values():
        theirs = ImageCms.profileToProfile(
            Image.fromarray(values), ImageCms.ImageCmsProfile(_stream(embedded)), srgb, renderingIntent=1
        )
        ours = of_profile(embedded).xyz(values.reshape(-1, 3) / 255)
        converted = target.xyz(np.asarray(theirs).reshape(-1, 3) / 255)
        inside = ((np.asarray(theirs) > 0) & (np.asarray(theirs) < 255)).all(-1).ravel()
        np.testing.assert_allclose(converted[inside], ours[inside], atol=0.006)


def _stream(embedded: bytes):
    import io

    return io.BytesIO(embedded)


@pytest.mark.parametrize("damage", [b"", b"x", PROFILES["adobe"][0][:140], PROFILES["adobe"][0][:300], bytes(500)])
def test_a_damaged_profile_describes_nothing(damage):
    assert of_profile(damage) is None


# --- CICP, chromaticities, Exif ---


def png(path: Path, **chunks: bytes) -> Path:
    saved(path, None)
    content = path.read_bytes()
    more = b""
    for name, data in chunks.items():
        body = name.encode() + data
        more += struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))
    path.write_bytes(content[:33] + more + content[33:])
    return path


def chromaticities(*values: float) -> bytes:
    return struct.pack(">8I", *(round(value * 100000) for value in values))


GAMMA = struct.pack(">I", 45470)
OF_ADOBE = chromaticities(0.3127, 0.329, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06)
OF_REC709 = chromaticities(0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
CHUNKS = {
    "primaries": ({"gAMA": GAMMA, "cHRM": OF_ADOBE}, "g22_adobergb_scene"),
    "rec. 709": ({"gAMA": GAMMA, "cHRM": OF_REC709}, "g22_rec709_scene"),
    "sRGB wins": ({"sRGB": b"\0", "gAMA": GAMMA, "cHRM": OF_ADOBE}, "srgb_rec709_scene"),
    "cICP wins": ({"cICP": bytes([12, 13, 0, 1]), "gAMA": GAMMA, "cHRM": OF_ADOBE}, "srgb_p3d65_scene"),
    "linear cICP": ({"cICP": bytes([9, 8, 0, 1])}, "lin_rec2020_scene"),
    "nothing": ({}, "srgb_rec709_scene"),
}


@pytest.mark.parametrize("kind", CHUNKS)
def test_chunks_of_png_by_their_precedence(tmp_path, kind):
    chunks, space = CHUNKS[kind]
    assert CONFIG.same(space_of(read(png(tmp_path / "a.png", **chunks)), CONFIG), space)


def test_cicp_without_a_space_is_refused(tmp_path):
    path = png(tmp_path / "a.png", cICP=bytes([9, 1, 0, 1]))
    with pytest.raises(ColorError, match="has CICP 9/1/0/1, which matches no color space"):
        filters.flatten(str(path))
    assert of_cicp((9, 1)) is not None


UNTAGGED = {"exr": "no color space tag", "tif": "no color space tag", "jpg": "uncalibrated", "png": "uncalibrated"}


@pytest.mark.parametrize(("suffix", "said"), UNTAGGED.items())
def test_a_copy_does_not_say_that_gamma_encoded_primaries_are_linear_or_srgb(tmp_path, suffix, said):
    png(tmp_path / "a.png", **CHUNKS["primaries"][0])
    assert run(["a.png", "-o", f"o.{suffix}"], tmp_path) == 0
    with pytest.raises(ColorError, match=said):
        space_of(read(tmp_path / f"o.{suffix}"), CONFIG)


@pytest.mark.parametrize("suffix", ["webp", "tga"])
def test_a_format_that_is_read_as_another_space_is_warned_about(tmp_path, caplog, suffix):
    png(tmp_path / "a.png", **CHUNKS["primaries"][0])
    assert run(["a.png", "-o", f"o.{suffix}"], tmp_path) == 0
    assert "cannot store chromaticities 0.64, 0.33, 0.21, 0.71" in caplog.text


def dcf(path: Path, order: str, index: bytes) -> Path:
    """A camera's JPEG without a profile: uncalibrated, with an index of interoperability."""

    def directory(tag: int, kind: int, count: int, value: bytes) -> bytes:
        return struct.pack(f"{order}HHHI", 1, tag, kind, count) + value + bytes(4)

    def at(place: int) -> bytes:
        return struct.pack(f"{order}I", place)

    exif = struct.pack(f"{order}2sHI", b"II" if order == "<" else b"MM", 42, 8) + directory(0x8769, 4, 1, at(26))
    entries = (0xA001, 3, 1, struct.pack(f"{order}HH", 65535, 0)), (0xA005, 4, 1, at(56))
    exif += struct.pack(f"{order}H", 2) + b"".join(directory(*entry)[2:-4] for entry in entries) + bytes(4)
    exif += directory(1, 2, 4, index)
    saved(path, None, exif=b"Exif\0\0" + exif)
    return path


@pytest.mark.parametrize("order", "<>")
def test_the_optional_color_space_of_cameras_is_adobe_rgb(tmp_path, order):
    path = dcf(tmp_path / "_DSC0001.jpg", order, b"R03\0")
    assert CONFIG.same(space_of(read(path), CONFIG), "g22_adobergb_scene")
    content = path.read_bytes()
    for damaged in (content.replace(b"R03\0", b"R98\0"), content.replace(struct.pack(f"{order}I", 56), b"\xff" * 4)):
        path.write_bytes(damaged)
        with pytest.raises(ColorError, match="uncalibrated"):
            space_of(read(path), CONFIG)


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp"])
@pytest.mark.parametrize("code", [2, 65535])
def test_uncalibrated_colors_are_refused(tmp_path, suffix, code):
    exif = Image.Exif()
    exif[0x0112] = 1  # Pillow writes no Exif of PNG without it
    exif.get_ifd(0x8769)[0xA001] = code
    path = saved(tmp_path / f"a.{suffix}", None, exif=exif)
    with pytest.raises(ColorError, match="has uncalibrated colors by Exif"):
        filters.flatten(str(path))
    assert CONFIG.same(space_of(read(saved(path, PROFILES["p3"][0], exif=exif)), CONFIG), "srgb_p3d65_scene")


@pytest.mark.parametrize(
    ("values", "space"),
    [
        ((0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767), "ACEScg"),
        ((0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329), "lin_rec709_scene"),
    ],
)
def test_chromaticities_of_an_untagged_exr(tmp_path, values, space):
    spec = oiio.ImageSpec(8, 8, 3, oiio.HALF)
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), values)
    buffer = oiio.ImageBuf(spec)
    assert buffer.write(str(tmp_path / "a.exr"))
    assert CONFIG.same(space_of(read(tmp_path / "a.exr"), CONFIG), space)


def test_what_the_user_says_wins(tmp_path):
    path = saved(tmp_path / "a.jpg", PROFILES["adobe"][0])
    made = filters.flatten(str(path), colorspace="ACEScg")
    assert CONFIG.same(made.spec().get_string_attribute("oiio:ColorSpace"), "ACEScg")
    line = "--noprogress a.jpg --iscolorspace srgb_rec709_scene --texflatten -o o.tif"
    assert run(shlex.split(line), tmp_path) == 0
    for op, out in (("--colorconvert srgb_rec709_scene", "said"), ("--tocolorspace", "o")):
        assert run(shlex.split(f"a.jpg {op} ACEScg -d float -o {out}.exr"), tmp_path) == 0
    said, described = (oiio.ImageBuf(str(tmp_path / name)).get_pixels(oiio.FLOAT) for name in ("said.exr", "o.exr"))
    assert np.abs(said - described).max() > 0.01
