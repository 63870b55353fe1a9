"""Frames as an animated GIF."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np

# Colours of a GIF, and rounds in which they are fitted to the frames.
PALETTE_COLOURS, PALETTE_ROUNDS = 255, 2
PALETTE_FROM_FRAMES, PALETTE_EVERY = 6, 3  # number of frames, and of their pixels every third, that determine the palette
NEARLY_WHITE = 248


def gif_bytes(frames: Sequence[np.ndarray], durations_s: Sequence[float], colours: int = PALETTE_COLOURS) -> bytes:
    """The file of an endless animation. All frames have the same palette, so that pixels that do not change need no space.

    Parameters
    ----------
    frames : (height, width, 3) of bytes each.
    durations_s : of each frame; the format rounds them to hundredths of a second.
    colours : size of the palette, at most 255.
    """
    from PIL import Image

    some = np.linspace(0, len(frames) - 1, min(len(frames), PALETTE_FROM_FRAMES)).round().astype(int)
    samples = Image.fromarray(np.concatenate([frames[number][::PALETTE_EVERY, ::PALETTE_EVERY] for number in some]))
    palette = samples.quantize(colours, method=Image.Quantize.MEDIANCUT, kmeans=PALETTE_ROUNDS)
    # Rounds of averaging leave white a little grey, and the picture would stand out from the page.
    entries = np.array(palette.getpalette(), dtype=int).reshape(-1, 3)
    entries[(entries >= NEARLY_WHITE).all(axis=1)] = 255
    palette.putpalette(entries.ravel().tolist())
    few = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [round(1e3 * duration) for duration in durations_s]
    buffer = io.BytesIO()
    few[0].save(buffer, format="GIF", save_all=True, append_images=few[1:], duration=durations, loop=0, optimize=True, disposal=1)
    return buffer.getvalue()
