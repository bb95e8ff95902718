# SPDX-License-Identifier: Apache-2.0
"""Files that other programs wrote, and our files in other programs; the oracle of reading is the wheel's oiiotool."""

import io
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import OpenImageIO as oiio
import pytest
import tifffile
from PIL import Image

from oiiotex.engine.errors import ColorError
from oiiotex.engine.io.reading import read
from oiiotex.oiiotool.cli.running.line_run import run
from tests.foreign_bytes import BY_SPECIFICATION, FLOATS, HEIGHT, WIDTH, psd, ramp
from tests.peer import OIIOTOOL, same
from tests.refusals import refused


def pil(channels: int = 3, mode: str = "", **how: object) -> Callable[[Path], object]:
    picture = Image.fromarray(ramp(channels) if channels > 1 else ramp(1)[..., 0])
    picture = picture.convert(mode) if mode else picture
    return lambda path: picture.save(path, **how)


def pnm(head: str, pixels: np.ndarray) -> Callable[[Path], object]:
    """By the format's description."""
    return lambda path: path.write_bytes(head.format(WIDTH, HEIGHT).encode() + pixels.tobytes())


def fits(path: Path) -> None:
    """By the standard: rows from the bottom, big-endian floats."""
    cards = ("SIMPLE  =                    T", "BITPIX  =                  -32", "NAXIS   =                    2",
             f"NAXIS1  = {WIDTH:20}", f"NAXIS2  = {HEIGHT:20}", "END")  # fmt: skip
    pixels = (ramp(1)[::-1, :, 0] / 255).astype(">f4").tobytes()
    head = "".join(card.ljust(80) for card in cards).ljust(2880).encode()
    path.write_bytes(head + pixels.ljust(-(-len(pixels) // 2880) * 2880, b"\0"))


def radiance(path: Path) -> None:
    """Flat RGBE pixels: value = mantissa / 256 * 2^(exponent - 128)."""
    pixels = np.concatenate([ramp(), np.full((HEIGHT, WIDTH, 1), 129, np.uint8)], -1)
    path.write_bytes(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {HEIGHT} +X {WIDTH}\n".encode() + pixels.tobytes())


FOREIGN: dict[str, Callable[[Path], object]] = {
    "rgb.bmp": pil(), "gray.bmp": pil(1), "palette.bmp": pil(mode="P"), "rgb.dds": pil(), "rgba.dds": pil(4),
    "palette.gif": pil(mode="P"), "rgba.ico": pil(4, sizes=[(16, 14)]), "lossless.jp2": pil(irreversible=False),
    "rgb.jpg": pil(), "gray.jpg": pil(1), "progressive.jpg": pil(progressive=True),
    "rgb.png": pil(), "rgba.png": pil(4), "palette.png": pil(mode="P"), "bits.png": pil(1, mode="1"),
    "rgb.sgi": pil(), "rle.tga": pil(compression="tga_rle"), "rgba.tga": pil(4),
    "rgb.tif": pil(), "lzw.tif": pil(compression="tiff_lzw"), "rgb.webp": pil(lossless=True),
    "big.tif": lambda path: tifffile.imwrite(path, ramp().astype(np.uint16) * 257, byteorder=">", bigtiff=True),
    "float.tif": lambda path: tifffile.imwrite(path, FLOATS, tile=(16, 16)),
    "planar.tif": lambda path: tifffile.imwrite(path, np.moveaxis(ramp(), -1, 0), planarconfig="separate",
                                                photometric="rgb"),
    "imageio.png": lambda path: imageio.imwrite(path, ramp()),
    "p4.pbm": pil(1, mode="1"), "p5.pgm": pil(1), "p6.ppm": pil(), "f.pfm": pil(1, mode="F"),
    "p6_16.ppm": pnm("P6\n{} {}\n65535\n", ramp().astype(">u2") * 257),
    "le.pfm": pnm("PF\n{} {}\n-1.0\n", FLOATS[::-1].astype("<f4")),
    "be.pfm": pnm("PF\n{} {}\n1.0\n", FLOATS[::-1].astype(">f4")),
    "gray.fits": fits, "flat.hdr": radiance,
    **BY_SPECIFICATION,
}  # fmt: skip


@pytest.mark.parametrize("name", FOREIGN)
def test_a_foreign_file_is_read_as_by_oiiotool(tmp_path, name):
    FOREIGN[name](tmp_path / name)
    subprocess.run([OIIOTOOL, name, "-d", "float", "-o", "theirs.exr"], cwd=tmp_path, check=True, capture_output=True)
    assert run(shlex.split(f"{name} -d float -o ours.exr"), tmp_path) == 0
    ours, theirs = (oiio.ImageBuf(str(tmp_path / f"{which}.exr")) for which in ("ours", "theirs"))
    np.testing.assert_array_equal(ours.get_pixels(oiio.FLOAT), theirs.get_pixels(oiio.FLOAT))
    assert ours.spec().channelnames == theirs.spec().channelnames


@pytest.mark.parametrize(
    "name", ["rgb.bmp", "rgb.png", "rgb.sgi", "rle.tga", "rgb.tif", "rgb.webp", "p6.ppm", "le.pfm", "be.pfm"]
)
def test_a_foreign_file_has_its_rows_from_the_top(tmp_path, name):
    FOREIGN[name](tmp_path / name)
    pixels = read(tmp_path / name).first.pixels()
    np.testing.assert_array_equal(pixels, FLOATS if name.endswith("pfm") else ramp())


@pytest.mark.parametrize("name", BY_SPECIFICATION)
def test_a_file_by_its_specification_has_the_values_that_were_put_in(tmp_path, name):
    """Halves and 10 bits are compared within their rounding."""
    FOREIGN[name](tmp_path / name)
    pixels = read(tmp_path / name).first.pixels()
    if pixels.dtype.kind == "u":
        pixels = pixels / np.iinfo(pixels.dtype).max
    expected = ramp(1) / 16 + 1 if name.endswith("zfile") else FLOATS
    np.testing.assert_allclose(pixels[..., : expected.shape[-1]], expected, atol=3e-3)


def test_layers_are_whole_where_they_extend_beyond_the_image(tmp_path):
    (tmp_path / "a.psd").write_bytes(psd({b"up": (-2, -1, 9, 12), b"down": (3, 4, 20, 30)}))
    same(tmp_path, "a.psd", "-o", "OUT.tif")
    same(tmp_path, "a.psd", "--subimage", "1", "-o", "OUT.tif")
    same(tmp_path, "a.psd", "--subimage", "1", "-o", "OUT.exr")


def test_names_in_other_encodings_are_spelled_out(tmp_path):
    (tmp_path / "a.psd").write_bytes(psd({b"caf\x8e": (0, 0, 14, 23), b"\xe9\xff": (0, 0, 14, 23)}))
    assert [part.name for part in read(tmp_path / "a.psd").parts] == ["part0", r"caf\x8e", r"\xe9\xff"]
    assert run(["a.psd", "--subimage", r"caf\x8e", "-o", "one.exr"], tmp_path) == 0
    assert run(["a.psd", "-o", "all.exr"], tmp_path) == 0
    assert read(tmp_path / "all.exr").part(r"\xe9\xff") is not None


def test_a_description_in_another_encoding_survives_a_filter(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", ramp(), photometric="rgb", description=b"\xa9 2003", metadata=None)
    words = ["a.tif", "--iscolorspace", "srgb_rec709_scene", "--texlab", "-o", "o.tif", "-d", "uint8", "-o", "o.jpg"]
    assert run(words, tmp_path) == 0
    for name in ("o.tif", "o.jpg"):
        assert run([name, "-o", "again.tif"], tmp_path) == 0
        spec = read(tmp_path / "again.tif").first.spec
        assert spec.get_string_attribute("ImageDescription").startswith("\\xa9 2003")


def test_an_icon_of_palette_colors_keeps_its_8_bits(tmp_path):
    """OpenImageIO's reader says 2 bits, the 8 of an index spread over four channels; oiiotool writes 2."""
    pil(mode="P", sizes=[(16, 14), (8, 7)])(tmp_path / "a.ico")
    assert run(shlex.split("a.ico -o o.tif"), tmp_path) == 0
    for wanted, stored in zip(read(tmp_path / "a.ico").parts, read(tmp_path / "o.tif").parts, strict=True):
        np.testing.assert_array_equal(stored.pixels(), wanted.pixels())


@pytest.mark.parametrize("suffix", ["bmp", "png", "tga", "tif", "sgi", "ppm", "pgm", "pfm", "webp"])
def test_our_files_are_upright_in_other_programs(tmp_path, suffix):
    """Gray where the other program reads only gray."""
    gray = suffix in ("pgm", "pfm")
    Image.fromarray(ramp(1)[..., 0] if gray else ramp()).save(tmp_path / "a.png")
    kind = "float" if suffix == "pfm" else "uint8"
    assert run(shlex.split(f"a.png -d {kind} --compression lossless -o o.{suffix}"), tmp_path) == 0
    theirs = np.asarray(Image.open(io.BytesIO((tmp_path / f"o.{suffix}").read_bytes())), np.float64)
    expected = (ramp(1)[..., 0] if gray else ramp()) / (255 if suffix == "pfm" else 1)
    np.testing.assert_allclose(theirs, expected, atol=1e-6)


def test_a_netpbm_file_has_no_known_color_space(tmp_path, caplog):
    """OpenImageIO tags all of them with a name that no config has."""
    FOREIGN["p6.ppm"](tmp_path / "a.ppm")
    assert run(shlex.split("a.ppm -o a.exr"), tmp_path) == 0 and not caplog.records
    with refused(ColorError, problem="has no color space tag ('oiio:ColorSpace')"):
        run(shlex.split("a.ppm --texflatten -o flat.exr"), tmp_path)
    assert run(shlex.split("a.ppm --iscolorspace srgb_rec709_scene --texflatten -o flat.exr"), tmp_path) == 0
