# SPDX-License-Identifier: Apache-2.0
"""--texzoom:movie=: GIFs are read back by Pillow, MP4s by what stands in for ffmpeg, or by ffmpeg where it is."""

from __future__ import annotations

import os
import shlex
import shutil
import stat
import sys
from pathlib import Path

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.io.movie import write_movie
from oiiotex.engine.session import Session
from oiiotex.filters import texzoom
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.refusals import refused

PHOTO = buffer(pictures.bricks(64, 64, seed=1))
ZOOM = {"size": (49, 32), "exemplarside": 64, "speed": 0.25, "count": 3}
FRAMES = [np.full((9, 13, 3), 60 * n, np.uint8) for n in range(4)]


def stand_in(folder: Path, text: str) -> None:
    """A program called ffmpeg that keeps what it was told and given."""
    program = folder / "ffmpeg"
    program.write_text(f'#!/bin/sh\nexec {shlex.join([sys.executable, "-c", f"import sys; {text}"])} "$@"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)


def test_a_gif_has_the_frames_of_the_zoom(tmp_path):
    image = pytest.importorskip("PIL.Image", reason="LEFT OUT: there is no Pillow")
    filters.zoom(PHOTO, movie=tmp_path / "z.gif", **ZOOM)
    with image.open(tmp_path / "z.gif") as gif:
        assert (gif.n_frames, gif.size, gif.info["duration"], gif.info["loop"]) == (3, (49, 32), 40, 0)
        for n in range(3):
            gif.seek(n)
            alone = pixels(filters.zoom(PHOTO, frame=1 + n, **{**ZOOM, "count": 2}))
            away = np.abs(np.asarray(gif.convert("RGB")) - 255 * np.clip(alone, 0, 1))
            assert away.mean() < 8  # of 256 colors, dithered


def test_ffmpeg_is_given_every_frame_and_its_file_takes_the_name(tmp_path, monkeypatch):
    keep = "open(sys.argv[-1], 'wb').write(sys.stdin.buffer.read());"
    keep += f"open({str(tmp_path / 'said')!r}, 'w').write(' '.join(sys.argv))"
    (tmp_path / "bin").mkdir()
    stand_in(tmp_path / "bin", keep)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}")
    monkeypatch.chdir(tmp_path)
    write_movie(Path("z.mp4"), FRAMES, 12.5)
    assert (tmp_path / "z.mp4").read_bytes() == b"".join(frame.tobytes() for frame in FRAMES)
    assert "-s 13x9 -r 12.5 -i pipe:0" in (tmp_path / "said").read_text()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bin", "said", "z.mp4"]


def test_a_failed_movie_leaves_the_old_one(tmp_path, monkeypatch):
    stand_in(tmp_path, "sys.stderr.write('no such\\nencoder'); sys.exit(1)")
    monkeypatch.setenv("PATH", f"{tmp_path}")
    (tmp_path / "z.mp4").write_bytes(b"old")
    with pytest.raises(errors.ImageError, match="ffmpeg: no such encoder"):
        write_movie(tmp_path / "z.mp4", FRAMES, 24)
    assert (tmp_path / "z.mp4").read_bytes() == b"old"

    def canceled():
        yield FRAMES[0]
        raise errors.Interrupted("enough")

    stand_in(tmp_path, "sys.stdin.buffer.read()")
    with pytest.raises(errors.Interrupted):
        write_movie(tmp_path / "z.mp4", canceled(), 24)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["ffmpeg", "z.mp4"]


def test_no_ffmpeg_of_the_current_folder_runs(tmp_path, monkeypatch):
    stand_in(tmp_path, "open('PWNED', 'w')")
    monkeypatch.chdir(tmp_path)
    for path in ("", ".", f".{os.pathsep}nowhere"):
        monkeypatch.setenv("PATH", path)
        with pytest.raises(errors.ImageError, match=r"ffmpeg.* \$PATH"):
            write_movie(Path("z.mp4"), FRAMES, 24)
    assert not (tmp_path / "PWNED").exists()


def test_ffmpeg_itself_takes_what_it_is_told(tmp_path):
    if shutil.which("ffmpeg") is None:
        pytest.skip("LEFT OUT: there is no ffmpeg")
    write_movie(tmp_path / "z.mp4", FRAMES, 24)
    assert (tmp_path / "z.mp4").read_bytes()[4:8] == b"ftyp"


def test_what_cannot_be_written_is_refused_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(texzoom.Zoom, "opened", None)
    with refused(errors.ImageError, expected=".gif or .mp4"):
        filters.zoom(PHOTO, movie=tmp_path / "z.avi")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(errors.ImageError, match="ffmpeg"):
        filters.zoom(PHOTO, movie=tmp_path / "z.mp4")


def test_limits_of_a_movie_are_said(tmp_path):
    with pytest.raises(errors.ParameterError, match=r"frame 1000 is at"):
        filters.zoom(PHOTO, movie=tmp_path / "z.gif", **{**ZOOM, "count": 1000})
    with refused(errors.ImageError, task="a GIF of 200 frames", budget=64 << 20):
        small = Session(budget=64 << 20)
        filters.zoom(
            PHOTO, movie=tmp_path / "z.gif", count=200, size=(640, 480), exemplarside=64, speed=0.001, session=small
        )
    assert not list(tmp_path.iterdir())
