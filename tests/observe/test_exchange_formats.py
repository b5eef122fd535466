"""Files exactly as DeepLabCut, SLEAP and OpenSim write them, and the same files broken."""

import pickle

import h5py
import numpy as np
import pytest

from backend.observe.exchange import deeplabcut, sleap, trc
from backend.observe.exchange.formats import format_of, read_points
from backend.observe.exchange.points import Points
from backend.observe.tracking_error import TrackingError

from .elsewhere import dlc_csv, dlc_table_h5, sleap_h5, trc_text

PX = {"pin": np.array([[10.5, 20.25], [11.0, 21.0], [12.0, 22.0]]), "tip": np.array([[1.0, 2.0], [3.0, 4.0], [5, 6]])}
SURE = {"pin": np.array([0.99, 0.5, 1.0]), "tip": np.array([0.9, 0.8, 0.7])}
AT = np.stack(list(PX.values()), 1)

AS_DEEPLABCUT_WRITES = """\
scorer,DLC_resnet50_linkageNov21shuffle1_100000,DLC_resnet50_linkageNov21shuffle1_100000,DLC_resnet50_linkageNov21shuffle1_100000
bodyparts,tip,tip,tip
coords,x,y,likelihood
0,413.8321838378906,206.04200744628906,0.9997797012329102
1,414.1022644042969,205.9822998046875,0.04125985503196716
2,,,
"""

AS_DEEPLABCUT_WRITES_MANY = """\
scorer,net,net,net,net,net,net
individuals,left,left,left,right,right,right
bodyparts,tip,tip,tip,tip,tip,tip
coords,x,y,likelihood,x,y,likelihood
0,1.0,2.0,0.9,3.0,4.0,0.8
"""


def seen(path, content):
    path.write_text(content) if isinstance(content, str) else path.write_bytes(content)
    return read_points(path)


def test_a_deeplabcut_csv_is_read_as_it_is_written(tmp_path):
    points = seen(tmp_path / "clipDLC.csv", AS_DEEPLABCUT_WRITES)
    assert points.names == ("tip",)
    assert points.in_pixels
    np.testing.assert_array_equal(
        points.at[:2, 0], [[413.8321838378906, 206.04200744628906], [414.1022644042969, 205.9822998046875]]
    )
    assert np.isnan(points.at[2]).all()
    np.testing.assert_array_equal(points.score[:2, 0], [0.9997797012329102, 0.04125985503196716])
    many = seen(tmp_path / "many.csv", AS_DEEPLABCUT_WRITES_MANY)
    assert many.names == ("left", "right")  # one point each: the individual is its name
    np.testing.assert_array_equal(many.at[0], [[1, 2], [3, 4]])


@pytest.mark.parametrize("layout", ["table", "fixed"])
def test_a_deeplabcut_hdf5_is_read_in_both_of_pandas_layouts(tmp_path, layout):
    """`fixed` is what our writer lays out; pandas.read_hdf of pandas 3.1 and PyTables 3.11 reads it."""
    path = tmp_path / "pose.h5"
    if layout == "table":
        dlc_table_h5(path, PX, SURE)
    else:
        score = np.stack(list(SURE.values()), 1)
        deeplabcut.write_h5(Points("x", ("pin", "tip"), np.arange(3), AT, score), path)
    assert format_of(path) == "DeepLabCut HDF5"
    points = read_points(path)
    assert points.names == ("pin", "tip")
    np.testing.assert_array_equal(points.at, AT)
    np.testing.assert_array_equal(points.score[:, 0], SURE["pin"])


def test_the_fixed_layout_is_that_of_pandas(tmp_path):
    """pandas.io.pytables.BlockManagerFixed: levels and labels of the columns, the rows' index, blocks turned over."""
    deeplabcut.write_h5(Points("x", ("pin", "tip"), np.arange(3), AT, np.ones((3, 2))), tmp_path / "pose.h5")
    with h5py.File(tmp_path / "pose.h5") as file:
        group = file["df_with_missing"]
        assert group.attrs["pandas_type"] == b"frame"
        assert group.attrs["axis0_nlevels"] == 3
        assert list(group["axis0_level1"][:]) == [b"pin", b"tip"]
        assert list(group["axis0_level2"][:]) == [b"x", b"y", b"likelihood"]
        assert list(group["axis0_label2"][:]) == [0, 1, 2, 0, 1, 2]
        assert group["axis0_level2"].attrs["name"] == b"coords"
        assert pickle.loads(bytes(group["axis1"].attrs["name"])) is None
        assert group["block0_values"].shape == (3, 6)
        assert group["block0_values"].attrs["transposed"] == 1
        # PyTables takes a fixed string for text only where it is marked as UTF-8.
        assert group.attrs.get_id("pandas_type").get_type().get_cset() == h5py.h5t.CSET_UTF8


def test_a_table_whose_columns_are_no_plain_text_runs_nothing_and_names_the_csv(tmp_path):
    path = dlc_table_h5(tmp_path / "pose.h5", PX, SURE)
    with h5py.File(path, "a") as file:
        harm = b"cos\nsystem\n(S'touch harm'\ntR."
        file["df_with_missing/table"].attrs["values_block_0_kind"] = np.bytes_(harm)
    with pytest.raises(
        TrackingError, match=r"layout that cannot be read.*os\.system is more than text.*Save it as CSV"
    ):
        read_points(path)
    with h5py.File(path, "a") as file:
        file["df_with_missing"].attrs["pandas_type"] = np.bytes_(b"wide")
    with pytest.raises(TrackingError, match=r"cannot be read \(wide\)\. Save it as CSV"):
        read_points(path)


def lines(*rows):
    return "\n".join(rows) + "\n"


HEAD = AS_DEEPLABCUT_WRITES.splitlines()[:3]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (lines(*HEAD[:2], "0,1,2,0.9"), "lacks the header row coords: its first rows begin with scorer, bodyparts, 0"),
        (lines(HEAD[0], HEAD[2], HEAD[1], "0,1,2,0.9"), "in the order scorer, coords, bodyparts"),
        (lines(*HEAD), "holds 0 frames"),
        (lines(*HEAD, "0,,,", "1,,,"), "2 frames and not one place"),
        (lines(*HEAD, "0,1,2,0.9", "1,1"), "row 5 has 2 cells, the headers 4"),
        (lines(*HEAD, "0,1,two,0.9"), "row 4 holds 'two', not a number"),
        (lines(*HEAD, "1,1,2,0.9", "0,1,2,0.9"), "frame 0 stands after frame 1 in row 2 of the data"),
        (lines(*HEAD, "0,1,2,0.9", "0,1,2,0.9"), "frame 0 stands after frame 0"),
        (lines(*HEAD, "labeled-data/clip/img0001.png,1,2,0.9"), "Labelled pictures are no tracks"),
        (lines(HEAD[0], HEAD[1], "coords,x,z,likelihood", "0,1,2,0.9"), "tip has no column y"),
        (lines(HEAD[0], HEAD[1], "coords,x,y,x", "0,1,2,0.9"), "a column stands twice"),
        (lines(*HEAD, "0,inf,2,0.9", "1,1,2,0.9"), "infinite"),
    ],
)
def test_a_broken_deeplabcut_file_is_refused_in_a_sentence(tmp_path, content, says):
    with pytest.raises(TrackingError, match=says):
        seen(tmp_path / "pose.csv", content)


def test_smoothed_tracks_are_told_from_raw_ones(tmp_path):
    path = dlc_csv(tmp_path / "pose_filtered.csv", PX, SURE)
    assert "impacts are blurred" in read_points(path).notes[0]


@pytest.mark.parametrize("dims", [False, True])
def test_a_sleap_file_is_read_whatever_the_order_of_its_axes(tmp_path, dims):
    px, score = {n: p[None] for n, p in PX.items()}, {n: s[None] for n, s in SURE.items()}
    points = read_points(sleap_h5(tmp_path / "a.h5", px, score, dims=dims))
    assert points.names == ("pin", "tip")
    np.testing.assert_array_equal(points.at, AT)
    np.testing.assert_array_equal(points.score[:, 0], SURE["pin"])


def test_an_older_sleap_file_has_neither_scores_nor_a_track_of_its_own(tmp_path):
    """As SLEAP wrote before point_scores, and for a project without tracks, whose track_names are empty."""
    px, score = {n: p[None] for n, p in PX.items()}, {n: s[None] for n, s in SURE.items()}
    path = sleap_h5(tmp_path / "a.h5", px, score)
    with h5py.File(path, "a") as file:
        del file["point_scores"], file["track_names"]
        file["track_names"] = np.zeros(0)
    points = read_points(path)
    np.testing.assert_array_equal(points.at, AT)
    assert np.isnan(points.score).all()


def test_tracks_that_never_meet_are_one_body_and_those_that_do_are_several(tmp_path):
    lost = np.full((3, 2), np.nan)
    first, second = PX["pin"].copy(), lost.copy()
    first[2], second[2] = np.nan, PX["pin"][2]
    score = {"pin": np.ones((2, 3))}
    joined = read_points(sleap_h5(tmp_path / "a.h5", {"pin": np.stack([first, second])}, score, tracks=("t0", "t1")))
    assert joined.names == ("pin",)
    np.testing.assert_array_equal(joined.at[:, 0], PX["pin"])
    assert "never meet" in joined.notes[0]
    both = np.stack([PX["pin"], PX["tip"]])
    apart = read_points(sleap_h5(tmp_path / "b.h5", {"pin": both}, score, tracks=("t0", "t1")))
    assert apart.names == ("t0", "t1")
    named = {"pin": both, "tip": both + 1}
    whole = read_points(sleap_h5(tmp_path / "c.h5", named, score | {"tip": score["pin"]}, tracks=("t0", "t1")))
    assert whole.names == ("t0.pin", "t0.tip", "t1.pin", "t1.tip")


def broken_sleap(path, spoil):
    px, score = {n: p[None] for n, p in PX.items()}, {n: s[None] for n, s in SURE.items()}
    with h5py.File(sleap_h5(path, px, score), "a") as file:
        for key, value in spoil.items():
            del file[key]
            if value is not None:
                file[key] = value
    return path


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        ({"node_names": None}, r"has no node_names; it holds"),
        ({"tracks": np.zeros((2, 2, 3))}, r"tracks has shape \(2, 2, 3\), not track x xy x node x frame"),
        ({"tracks": np.zeros((3, 2, 2, 1)), "track_names": [b"t"]}, r"point_scores has shape \(1, 2, 3\)"),
        ({"tracks": np.zeros((1, 3, 2, 3))}, r"tracks is 1 x 3 x 2 x 3, not track x 2 x node"),
        ({"node_names": [b"a", b"b", b"c"]}, r"with the 3 nodes of node_names"),
        ({"point_scores": np.zeros((1, 2, 5))}, r"point_scores has shape \(1, 2, 5\).*should be \(1, 2, 3\)"),
        ({"track_occupancy": np.zeros((1, 3))}, r"track_occupancy has shape \(1, 3\).*should be \(3, 1\)"),
        ({"tracks": np.full((1, 2, 2, 3), np.nan)}, r"3 frames and not one place"),
        (
            {"tracks": np.zeros((1, 2, 2, 0)), "point_scores": None, "track_occupancy": np.zeros((0, 1))},
            r"holds 0 frames",
        ),
    ],
)
def test_a_broken_sleap_file_is_refused_with_its_shapes(tmp_path, spoil, says):
    with pytest.raises(TrackingError, match=says):
        read_points(broken_sleap(tmp_path / "a.h5", spoil))


def test_hdf5_of_something_else_or_cut_short_is_refused(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["voltage"] = np.zeros(3)
    with pytest.raises(TrackingError, match=r"holds voltage, which is no table of tracks.*Known are"):
        read_points(tmp_path / "other.h5")
    whole = dlc_table_h5(tmp_path / "pose.h5", PX, SURE).read_bytes()
    (tmp_path / "cut.h5").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(TrackingError, match=r"cut\.h5 is an HDF5 file that .* Copy it again"):
        read_points(tmp_path / "cut.h5")


TIMES = np.array([0.0, 0.01, 0.02])
METRES = {"pin": np.c_[PX["pin"] / 100, [0.1, 0.2, 0.3]], "tip": np.c_[PX["tip"] / 100, [0.0, 0.0, 0.0]]}


def test_a_trc_file_is_read_as_opensim_shows_it(tmp_path):
    gone = METRES | {"tip": METRES["tip"].copy()}
    gone["tip"][1] = np.nan
    for text in (trc_text(gone, TIMES), trc_text(gone, TIMES).replace("\n", "\r\n"), "\ufeff" + trc_text(gone, TIMES)):
        (tmp_path / "walk.trc").write_text(text, newline="")
        points = read_points(tmp_path / "walk.trc")
        assert points.names == ("pin", "tip")
        np.testing.assert_array_equal(points.frame, [0, 1, 2])
        np.testing.assert_allclose(points.time_s, TIMES, atol=1e-9)
        np.testing.assert_allclose(points.at, np.stack(list(gone.values()), 1), atol=1e-8)  # five decimals of a mm


def test_a_trc_file_written_has_the_rows_that_readers_count_on(tmp_path):
    at = np.stack(list(METRES.values()), 1)
    at[2, 1] = np.nan
    points = Points("x", ("pin", "tip"), np.arange(3), at, np.ones((3, 2)), TIMES)
    text = trc.write_trc(points, tmp_path / "out.trc").read_text()
    rows = [row.split("\t") for row in text.splitlines()]
    assert rows[0] == ["PathFileType", "4", "(X/Y/Z)", "out.trc"]
    assert dict(zip(rows[1], rows[2], strict=True))["NumFrames"] == "3"
    assert rows[3] == ["Frame#", "Time", "pin", "", "", "tip", "", ""]
    assert rows[4] == ["", "", "X1", "Y1", "Z1", "X2", "Y2", "Z2"]
    assert rows[5] == [""]
    assert rows[6] == [
        "1",
        "0.000000000",
        "105.000000",
        "202.500000",
        "100.000000",
        "10.000000",
        "20.000000",
        "0.000000",
    ]
    assert rows[8][5:] == ["", "", ""]
    np.testing.assert_allclose(read_points(tmp_path / "out.trc").at, at, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("\tmm\t", "\tinches\t", "Units is 'inches'; it must be one of"),
        ("Units\t", "", "Units is 'missing'"),
        ("PathFileType", "Path", "first row does not begin with PathFileType"),
        ("Frame#\tTime", "Time\tFrame#", "row 4 begins with"),
        ("\t3\t2\tmm", "\t3\t5\tmm", "NumMarkers is 5, but row 4 names 2"),
        ("2\t0.010000", "2\t-0.010000", r"row 8 \(frame 2, -0.01 s\) stands after frame 1 at 0 s"),
        ("3\t0.020000", "1\t0.020000", r"row 9 \(frame 1, 0.02 s\) stands after frame 2"),
        ("2\t0.010000", "2\t", "row 8 has no frame number or no time"),
        ("2\t0.010000", "2\tlater", "row 8: could not convert string to float: 'later'"),
        ("2\t0.010000\t", "2\t0.010000\t7\t7\t7\t7\t", "row 8 has 12 cells; 2 markers need 8"),
    ],
)
def test_a_broken_trc_file_is_refused_with_its_row(tmp_path, old, new, says):
    text = trc_text(METRES, TIMES)
    assert old in text
    with pytest.raises(TrackingError, match=says):
        seen(tmp_path / "walk.trc", text.replace(old, new))


def test_a_trc_file_without_data_or_cut_short_says_so(tmp_path):
    text = trc_text(METRES, TIMES)
    with pytest.raises(TrackingError, match="holds 0 frames"):
        seen(tmp_path / "none.trc", "".join(text.splitlines(keepends=True)[:6]))
    cut = seen(tmp_path / "cut.trc", "".join(text.splitlines(keepends=True)[:8]))
    assert "promises 3 frames and holds 2" in cut.notes[0]
    empty = {n: np.full((3, 3), np.nan) for n in METRES}
    with pytest.raises(TrackingError, match="not one place"):
        seen(tmp_path / "nan.trc", trc_text(empty, TIMES))


def test_every_coordinate_survives_each_writer(tmp_path):
    rng = np.random.default_rng(1)
    at, score = rng.uniform(0, 2000, (30, 3, 2)), rng.uniform(0, 1, (30, 3))
    at[4, 1] = np.nan
    points = Points("x", ("a", "b", "c"), np.arange(30), at, score)
    for write, name in ((deeplabcut.write_csv, "a.csv"), (deeplabcut.write_h5, "a.h5"), (sleap.write_h5, "b.h5")):
        back = read_points(write(points, tmp_path / name))
        np.testing.assert_array_equal(back.at, at)
        np.testing.assert_array_equal(back.score, score)
        assert back.names == points.names
