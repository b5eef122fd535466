"""Points of a bare bar, followed by their surroundings."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from backend.observe.cotracker import SIZE as SMALL
from backend.observe.cotracker import cotracker, rough_paths
from backend.observe.measure import track_video
from backend.observe.texture import Surroundings
from backend.observe.tracking_error import TrackingError

from .textured_bar import POINTS_M, SIZE, bed, drawing, film, in_picture, picture, turned

FRAMES = 40
ANGLE = 0.7 * np.sin(np.linspace(0, np.pi, FRAMES)) ** 2  # up by 40 degrees and back: 1.5 m/s^2 at the far point
TRUTH = turned(ANGLE, list(POINTS_M.values()))
BARE = dict.fromkeys(POINTS_M, "texture")


def errors_mm(tracks):
    """(frame, point); NaN where not observed."""
    off = tracks[["x_m", "y_m"]].to_numpy().reshape(-1, len(POINTS_M), 2) - TRUTH
    seen = tracks.status.eq("observed").to_numpy().reshape(-1, len(POINTS_M))
    return np.where(seen, 1e3 * np.hypot(*np.moveaxis(off, -1, 0)), np.nan)


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bar")
    clip = film(folder / "bar.mp4", ANGLE)
    return track_video(clip, drawing(), bed(), out_dir=folder, targets=BARE, preview=False)


def test_a_bare_surface_is_followed_to_a_twentieth_of_a_millimetre_without_drift(followed):
    off = errors_mm(followed.tracks)
    assert np.isfinite(off).mean() > 0.98
    assert np.nanmedian(off) < 0.05  # mm: a tenth of a pixel; noise of 1.5 codes on a grain of 30 leaves 0.04
    assert np.nanmax(off) < 0.15
    assert np.nanmedian(off[-8:]) < 1.5 * np.nanmedian(off[:8])  # back where it began: nothing has added up


def test_its_deviations_are_honest(followed):
    squared = (errors_mm(followed.tracks) * 1e-3) ** 2 / 2
    sigma = followed.tracks.sigma_m.to_numpy().reshape(-1, len(POINTS_M))
    assert 0.3 < np.nanmean(squared / sigma**2) < 3  # two points of fifty frames settle it no better


def test_what_a_hidden_start_would_cost_is_said(followed):
    assert any("marker_offset" in said for said in followed.summary["warnings"])


def test_a_covered_point_is_not_believed_and_is_found_again(tmp_path):
    hidden = range(10, 16)
    spot = turned(ANGLE, [POINTS_M["far"]])[:, 0]

    def card(k):
        return (*spot[k], 0.012) if k in hidden else None

    clip = film(tmp_path / "card.mp4", ANGLE, card=card)
    off = errors_mm(track_video(clip, drawing(), bed(), out_dir=tmp_path, targets=BARE, preview=False).tracks)
    assert np.isnan(off[list(hidden), 1]).all()
    assert np.isfinite(off[list(hidden), 0]).all()
    assert np.nanmax(off[20:, 1]) < 0.15


def test_a_smooth_surface_is_refused_by_name(tmp_path):
    clip = film(tmp_path / "smooth.mp4", ANGLE[:3], contrast=0.0)
    with pytest.raises(TrackingError, match=r"near, far .* too smooth .* ringed dot"):
        track_video(clip, drawing(), bed(), out_dir=tmp_path, targets=BARE, preview=False)


@pytest.mark.parametrize("reach", [400, 10_000])
def test_more_than_the_picture_shows_cannot_count(reach, tmp_path):
    clip = film(tmp_path / "wide.mp4", ANGLE[:3])
    targets = dict.fromkeys(POINTS_M, f"texture:{reach}")
    with pytest.raises(TrackingError, match=rf"within {reach} px of the picture's edge"):
        track_video(clip, drawing(), bed(), out_dir=tmp_path, targets=targets, preview=False)


def test_surroundings_of_any_size_are_laid_over_the_next_picture():
    """34 000 pixels of a disc are more than one row of OpenCV's remap may hold."""
    luma = picture(0.0, np.random.default_rng(3))
    own = Surroundings(luma, np.array([[240.0, 180.0]]), 104)
    moved = np.roll(luma, (2, 3), (0, 1))
    warp, alike, _ = own.lay(moved, np.array([[[1.0, 0.0, 240.0], [0.0, 1.0, 180.0]]]))
    assert alike.all()
    np.testing.assert_allclose(warp[0, :, 2], [243.0, 182.0], atol=0.02)


def test_stickers_and_bare_surfaces_do_not_mix(tmp_path):
    clip = film(tmp_path / "mixed.mp4", ANGLE[:3])
    with pytest.raises(TrackingError, match=r"far are to be followed by their texture"):
        track_video(clip, drawing(), bed(), out_dir=tmp_path, targets={"near": 3, "far": "texture"})


def test_cotracker_is_asked_for_by_name_where_it_is_missing(tmp_path, monkeypatch):
    with pytest.raises(TrackingError, match=r"no CoTracker checkpoint .*weights\.pth"):
        cotracker(tmp_path / "weights.pth")
    (tmp_path / "weights.pth").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(TrackingError, match=r"CoTracker is not installed .* Install PyTorch"):
        cotracker(tmp_path / "weights.pth")


def test_weights_of_another_model_are_refused_by_the_files_name(tmp_path, monkeypatch):
    """PyTorch says a RuntimeError of the online model's weights, an UnpicklingError of what is no checkpoint."""

    def refuses(checkpoint):
        raise RuntimeError("size mismatch for time_emb: [1, 16, 1110] from checkpoint, [1, 60, 1110] in current model")

    (tmp_path / "scaled_online.pth").write_bytes(b"weights")
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "cotracker.predictor", SimpleNamespace(CoTrackerPredictor=refuses))
    with pytest.raises(TrackingError, match=r"scaled_online\.pth does not hold .* offline model .*scaled_offline\.pth"):
        cotracker(tmp_path / "scaled_online.pth")


class Numbers(np.ndarray):
    """An array that answers as a tensor does."""

    def to(self, where):
        return self

    def cpu(self):
        return self

    def numpy(self):
        return np.asarray(self)


def test_rough_paths_go_from_chunk_to_chunk_in_the_clips_own_pixels(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(from_numpy=lambda a: a.view(Numbers)))
    step = np.array([1.0, 0.5])  # small pixels a picture

    def drifts(video, queries):
        pictures = np.arange(video.shape[1])[:, None, None]
        return (queries[0, :, 1:] + pictures * step)[None].view(Numbers), None

    drifts.parameters = lambda: iter([SimpleNamespace(device="cpu")])
    frame = SimpleNamespace(luma=np.zeros(SIZE[::-1], np.uint8), bgr=lambda: np.zeros((*SIZE[::-1], 3), np.uint8))
    start = in_picture(list(POINTS_M.values()))
    paths = rough_paths(drifts, [frame] * 100, start)
    per_picture = step * (np.array(SIZE) - 1) / (np.array(SMALL) - 1)
    np.testing.assert_allclose(paths, start + np.arange(100)[:, None, None] * per_picture, atol=1e-3)  # float32


def test_a_smooth_bar_is_followed_where_more_of_it_counts(tmp_path):
    """Nothing is printed at the point; the end of the bar, 30 pixels away, tells where it is."""
    angle = np.linspace(0, 0.03, 5)
    clip = film(tmp_path / "smooth.mp4", angle, contrast=0.0)
    only = drawing("far")
    with pytest.raises(TrackingError, match='"texture:20"'):
        track_video(clip, only, bed(), out_dir=tmp_path, targets={"far": "texture"}, preview=False)
    made = track_video(clip, only, bed(), out_dir=tmp_path, targets={"far": "texture:34"}, preview=False)
    off = made.tracks[["x_m", "y_m"]].to_numpy() - turned(angle, [POINTS_M["far"]])[:, 0]
    assert made.tracks.status.eq("observed").all()
    assert np.hypot(*off.T).max() < 5e-4  # the bed round about does not turn with the bar
