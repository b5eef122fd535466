"""A tag on a marker is sought where its motion puts it, and known by its pattern where it cannot be read."""

import cv2
import numpy as np
import pytest

from backend.observe.kit import tag_cells
from backend.observe.tag_names import KIT, Tag
from backend.observe.tags import outlines
from backend.observe.targets import TagTargets
from backend.observe.track import ConstantVelocity
from backend.observe.tracking_error import TrackingError
from backend.observe.video import Frame

SIDE, RATE = 40, 240
TAGS = (Tag(KIT, 21), Tag("aruco_4x4_50", 21), Tag("aruco_5x5_1000", 321), Tag("apriltag_16h5", 21))


def place(k):
    """Centre [px] and turn [rad] of the tag in picture k: 6 px and 3 degrees from picture to picture."""
    return np.array([120.0 + 6 * k, 150.0 + 2 * k]), np.deg2rad(3.0 * k)


def picture(k, blur_px=0, covered=False, twin=False, tag=TAGS[0]):
    """The tag on grey, in so much noise; blurred along its motion; half covered by a hand; or printed twice."""
    cells = np.pad(np.pad(tag_cells(tag.number, tag.family), 1), 1)
    fine = np.kron(np.where(cells, 40.0, 190.0), np.ones((16, 16))).astype(np.float32)
    fine[:16], fine[-16:], fine[:, :16], fine[:, -16:] = 150, 150, 150, 150
    scale = SIDE / (16 * (len(cells) - 4))
    at, turn = place(k)
    c, s = scale * np.cos(turn), scale * np.sin(turn)
    seen = np.zeros((300, 500), np.float32)
    for share in np.linspace(-0.5, 0.5, 2 * blur_px + 1):
        middle = at + blur_px * share * np.array([0.95, 0.31])
        A = np.array([[c, -s], [s, c]])
        move = np.c_[A, middle - A @ np.full(2, (len(fine) - 1) / 2)]
        seen += cv2.warpAffine(fine, move, (500, 300), flags=cv2.INTER_AREA, borderValue=(150.0,))
    seen = cv2.GaussianBlur(seen / (2 * blur_px + 1), (0, 0), 1.0)
    if twin:
        seen[:, 380:480] = seen[:, int(at[0]) - 50 : int(at[0]) + 50]
    if covered:
        seen[:, : int(at[0])] = 90
    noisy = seen + np.random.default_rng(k).normal(0, 2, seen.shape)
    luma, grey = np.clip(noisy, 0, 255).astype(np.uint8), np.full((150, 250), 128, np.uint8)
    return Frame(k, k / RATE, luma, grey, grey, None, 0)


@pytest.fixture(params=TAGS, ids=str)
def tag(request):
    return request.param


@pytest.fixture
def followed(tag):
    """Followed through its first four pictures."""
    targets = TagTargets(picture(0, tag=tag), {"tip": tag})
    targets.start(ConstantVelocity(0.0, targets.found.px[targets.order], 1e5))
    for k in range(1, 4):
        assert seen(targets, picture(k, tag=tag)) is not None
    return targets


def seen(targets, frame):
    """Where the tag is seen, and whether in whole; None where it is not seen."""
    found, (k,), _ = targets.step(frame)
    return (found.px[k], bool(found.whole[k])) if k >= 0 else None


def test_a_tag_too_blurred_to_be_read_is_placed_by_its_pattern(followed, tag):
    blurred = picture(4, blur_px=9, tag=tag)
    assert outlines(blurred.luma, tag.family) == [] or tag.family == "apriltag_16h5"  # of large cells: read even so
    at, whole = seen(followed, blurred)
    assert whole
    assert np.hypot(*(at - place(4)[0])) < 0.05  # px; 0.02 is usual


@pytest.mark.parametrize("code", [40, 90, 150, 190])
@pytest.mark.parametrize("share", [0.05, 0.15, 0.3])  # a twentieth can still be read, by corners that are not its own
def test_a_tag_that_is_partly_covered_is_never_called_whole_and_misplaced(followed, tag, share, code):
    frame = picture(4, tag=tag)
    frame.luma[:, : int(place(4)[0][0] + (share - 0.5) * SIDE)] = code
    if found := seen(followed, frame):
        at, whole = found
        assert np.hypot(*(at - place(4)[0])) < (0.2 if whole else 0.5 * followed.radius_px)


def test_a_tag_of_which_half_is_covered_is_not_seen_and_is_found_again(followed, tag):
    for k in range(4, 9):
        assert seen(followed, picture(k, covered=True, tag=tag)) is None
    assert np.hypot(*(seen(followed, picture(9, tag=tag))[0] - place(9)[0])) < 0.1


def test_a_second_print_elsewhere_does_not_disturb(followed, tag):
    assert np.hypot(*(seen(followed, picture(4, twin=True, tag=tag))[0] - place(4)[0])) < 0.1


def test_tags_of_another_family_are_named_where_the_kits_are_sought():
    shown = picture(0, tag=Tag("aruco_4x4_50", 21))
    with pytest.raises(TrackingError, match=r'Tags 21 of aruco_4x4_50 are seen: name them "aruco_4x4_50:21"'):
        TagTargets(shown, {"tip": Tag(KIT, 21)})
