# SPDX-License-Identifier: Apache-2.0
"""Movies: GIF by Pillow, MP4 (H.264) by ffmpeg, if they are installed."""

from __future__ import annotations

import importlib.util
import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path

from ..deferred import np
from ..errors import ImageError, present
from ..machine import program, start
from .atomic import temporary_beside

# The file is tagged with its color space; H.264 with 4:2:0 subsampling requires even sides.
_FILTERS = "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv"
_SPACE = ("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1")
_SAYS = (*_SPACE, "-movflags", "+faststart+write_colr")


def require_encoder(path: Path) -> None:
    """Refuse a movie that cannot be written on this machine.

    Raises
    ------
    ImageError
        The suffix is not .gif or .mp4, or the encoder is missing.
    """
    suffix = path.suffix.lower()
    if suffix not in (".gif", ".mp4"):
        raise ImageError(f"{path}: unknown type of movie", expected=".gif or .mp4")
    if suffix == ".gif" and importlib.util.find_spec("PIL") is None:
        raise ImageError(f"{path}: a GIF requires Pillow", hint="pip install pillow")
    if suffix == ".mp4":
        _ffmpeg(path)


def write_movie(path: Path, frames: Iterable[np.ndarray], rate: float) -> None:
    """Write a movie atomically.

    Parameters
    ----------
    path : Path
    frames : iterable of (height, width, 3) uint8
        sRGB frames of one size.
    rate : float
        Frames per second.

    Raises
    ------
    ImageError
        As `require_encoder`, or ffmpeg fails.
    """
    require_encoder(path)
    write = _write_gif if path.suffix.lower() == ".gif" else _write_mp4
    with temporary_beside(path) as temporary:
        write(temporary, iter(frames), rate)


def _write_gif(path: Path, frames: Iterator[np.ndarray], rate: float) -> None:
    from PIL import Image

    first, *others = (Image.fromarray(frame).quantize(256, dither=Image.Dither.FLOYDSTEINBERG) for frame in frames)
    hundredths = max(2, round(100 / rate))  # browsers replace shorter durations by a slow default
    first.save(path, "GIF", save_all=True, append_images=others, duration=10 * hundredths, loop=0)


def _write_mp4(path: Path, frames: Iterator[np.ndarray], rate: float) -> None:
    first = next(frames)
    height, width = first.shape[:2]
    source = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {rate:g} -i pipe:0".split()
    target = f"-an -vf {_FILTERS} -c:v libx264 -crf 18 -pix_fmt yuv420p".split()
    command = [_ffmpeg(path), "-y", "-loglevel", "error", *source, *target, *_SAYS, "-f", "mp4", str(path.absolute())]
    from subprocess import DEVNULL, PIPE  # rarely needed

    with start(command, stdin=PIPE, stdout=DEVNULL, stderr=PIPE) as ffmpeg:
        try:
            for frame in itertools.chain([first], frames):
                present(ffmpeg.stdin).write(np.ascontiguousarray(frame).tobytes())
            _, message = ffmpeg.communicate()
        except BrokenPipeError:  # ffmpeg reports the reason
            message = present(ffmpeg.stderr).read()
        except BaseException:
            ffmpeg.kill()
            raise
    if ffmpeg.returncode:
        raise ImageError(f"{path.name}: ffmpeg: {' '.join(message.decode(errors='replace').split())[-300:]}")


def _ffmpeg(path: Path) -> str:
    found = program("ffmpeg")
    if found is None:
        raise ImageError(f"{path}: an MP4 requires ffmpeg, which is not in $PATH", hint="install it, or write a .gif")
    return found
