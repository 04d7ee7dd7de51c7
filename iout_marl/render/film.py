"""Frames as a film: an animated GIF, or an MP4 that browsers and slides play."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from iout_marl.errors import InputError
from iout_marl.files import refuse_input, write_atomically

Frame = npt.NDArray[np.uint8]

#: A palette found over all frames, and of each frame what has changed.
_PALETTE = (
    "split[a][b];[a]palettegen=max_colors=128[p];[b][p]paletteuse=dither=none:diff_mode=rectangle"
)
#: Codec, form of the pixels and further options of ffmpeg by the ending of the file. An MP4 is
#: one that every player takes.
_CODECS: dict[str, tuple[str, str, list[str]]] = {
    ".gif": ("gif", "pal8", ["-vf", _PALETTE, "-loop", "0"]),
    ".mp4": ("libx264", "yuv420p", ["-crf", "20", "-movflags", "+faststart"]),
}
ENDINGS = tuple(_CODECS)


def write_film(path: Path, frames: Iterable[Frame], fps: float) -> None:
    """Write frames as a film, whole or not at all.

    Args:
        path: the file, which ends in .gif or .mp4.
        frames: (height, width, 3) pixels each, all of one size with even edges.
        fps: frames a second.

    Raises:
        InputError: the name ends otherwise, or the file cannot be written.
    """
    ending = path.suffix.lower()
    if ending not in _CODECS:
        raise InputError(f"{path}: a film is a .gif or an .mp4")
    refuse_input(path)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / f"film{ending}"
        _encode(made, frames, fps)
        write_atomically(path, made.read_bytes())


def _encode(path: Path, frames: Iterable[Frame], fps: float) -> None:
    import imageio_ffmpeg

    writer = None
    try:
        for frame in frames:
            if writer is None:
                height, width, _ = frame.shape
                codec, pixels, options = _CODECS[path.suffix]
                writer = imageio_ffmpeg.write_frames(
                    str(path),
                    (width, height),
                    fps=fps,
                    codec=codec,
                    quality=None,
                    macro_block_size=2,
                    pix_fmt_out=pixels,
                    output_params=options,
                )
                writer.send(None)
            writer.send(np.ascontiguousarray(frame))
    finally:
        if writer is not None:
            writer.close()
