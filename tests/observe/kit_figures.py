"""Print the figures of docs/kit.md: `python -m tests.observe.kit_figures` (a minute on one core)."""

import cv2
import numpy as np

from backend.observe.board_views import find_board
from backend.observe.calibrate_camera import camera_from
from backend.observe.tags import find_tags

from .board_scenes import BENDS, SIZE, K, board_poses, computed_views, lean, photograph, tag_centres_mm

TRUTH = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *BENDS])
MIDDLE = (105.0, 148.5)


def lens_row(name, boards):
    cameras = [camera_from(views, SIZE) for views in boards]
    off = np.array([c.values() - TRUTH for c in cameras])[:, :8]
    z = off / np.array([np.sqrt(np.diag(c.covariance))[:8] for c in cameras])
    focal = 100 * np.abs(off[:, :2] / TRUTH[:2])
    rms = np.mean([c.reprojection_rms_px for c in cameras])
    print(
        f"| {name} | {rms:.3f} | {np.sqrt((focal**2).mean()):.3f} / {focal.max():.3f} | {np.sqrt((z**2).mean()):.2f} |"
    )


def photographed(seed):
    seen = [find_board(photograph(R, at, seed=99 * seed + k, noise=3.0), "") for k, (R, at) in board(seed)]
    return [view for view in seen if view]


def board(seed):
    return enumerate(board_poses(14, seed=50 + seed))


def tag_row(away_mm):
    off = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        R = lean(*rng.uniform(-15, 15, 2), rng.uniform(-180, 180) if seed % 2 else rng.uniform(86, 94))
        at = (rng.uniform(-0.1, 0.1) * away_mm, rng.uniform(-0.05, 0.05) * away_mm, float(away_mm))
        found = find_tags(photograph(R, at, name="tags", about_mm=MIDDLE, seed=seed, noise=2.5))
        page = np.c_[np.array(list(tag_centres_mm().values())) - MIDDLE, np.zeros(9)]
        true = cv2.projectPoints(page, cv2.Rodrigues(R)[0], np.array(at), K, BENDS)[0].reshape(-1, 2)
        off += [np.hypot(*(laid.centre_px - true[tag.number])) for tag, laid in found.items()]
    print(f"| {40e-3 * 1e3 / away_mm * K[0, 0]:.0f} | {np.sqrt(np.mean(np.square(off))):.3f} / {max(off):.3f} |")


def main():
    print("| views | misfit, px | focal length, rms / max error, % | rms of error over its sd |\n|---|---|---|---|")
    lens_row("8 times 14 photos of the printed page", [photographed(seed) for seed in range(8)])
    for sag in (0.0, 0.3, 1.0):
        boards = [computed_views(300 + seed, 18, sag) for seed in range(12)]
        lens_row(f"12 times 18 views, corners to 0.05 px, board bent by {sag:g} mm", boards)
    print("\n| tag, px | centre, rms / max error, px |\n|---|---|")
    for away_mm in (330, 420, 700, 1000, 1300):
        tag_row(away_mm)


if __name__ == "__main__":
    main()
