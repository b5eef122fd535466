"""Rough paths of points by CoTracker (Karaev et al. 2024), for those who have it: its package, PyTorch, a checkpoint.

It works on pictures of 512 x 384: a pixel there is several of the clip's.  Its paths say where to look, no more.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from backend.observe.tracking_error import TrackingError
from backend.observe.video import Frame

SIZE = (512, 384)
PICTURES = 47  # looked at together with the one before; its window is 60


def cotracker(checkpoint: str | Path) -> Any:
    """The predictor with the user's own weights, on a GPU where there is one.

    Raises TrackingError where the package, PyTorch or the checkpoint is missing, or the weights are another model's.
    """
    if not Path(checkpoint).is_file():
        raise TrackingError(f"There is no CoTracker checkpoint {checkpoint}. Give the path of its weights.")
    try:
        torch = importlib.import_module("torch")
        predictor = importlib.import_module("cotracker.predictor")
    except ImportError as error:
        raise TrackingError(
            f"CoTracker is not installed here ({error}). Install PyTorch and its cotracker package in this "
            "environment, or leave the checkpoint out: Lucas-Kanade needs neither."
        ) from error
    try:
        model = predictor.CoTrackerPredictor(checkpoint=str(checkpoint))
    except Exception as error:  # PyTorch refuses what is no checkpoint, and weights of another shape, in many ways
        raise TrackingError(
            f"{Path(checkpoint).name} does not hold the weights of CoTracker 3's offline model "
            f"({type(error).__name__}). Give those (scaled_offline.pth), not the online model's or CoTracker 2's."
        ) from error
    return model.to("cuda") if torch.cuda.is_available() else model


def rough_paths(
    model: Any, frames: Iterable[Frame], start_px: Float[np.ndarray, "marker 2"]
) -> Float[np.ndarray, "frame marker 2"]:
    """Where points of the first picture go [px], as a predictor sees them.

    model: called with pictures (1, t, 3, h, w) and queries (1, marker, 3) of t, x, y, answers (1, t, marker, 2).
    """
    torch = importlib.import_module("torch")
    pictures = iter(frames)
    first = next(pictures)
    scale = (np.array(SIZE) - 1) / (np.array(first.luma.shape)[::-1] - 1)
    paths, last, before = [np.asarray(start_px, float)[None]], np.asarray(start_px, float) * scale, _small(first)
    while chunk := list(islice(pictures, PICTURES)):
        shown = np.stack([before, *map(_small, chunk)])
        video = torch.from_numpy(np.moveaxis(shown, -1, 1)[None].astype(np.float32))
        queries = torch.from_numpy(np.c_[np.zeros(len(last)), last][None].astype(np.float32))
        where = next(model.parameters()).device
        found, _ = model(video.to(where), queries=queries.to(where))
        path = found[0].cpu().numpy().astype(float)
        paths.append(path[1:] / scale)
        last, before = path[-1], shown[-1]
    return np.concatenate(paths)


def _small(frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
    """The picture as CoTracker sees it."""
    return cv2.cvtColor(cv2.resize(frame.bgr(), SIZE, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2RGB)
