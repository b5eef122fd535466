"""Tables as other programs write them: what is wrong with all of a file is told in one sentence, with the remedy."""

import pytest

from backend.mechanism.drawing_error import DrawingError
from backend.mechanism.likewise import likewise
from backend.mechanism.tracks import read_table
from tests.mechanisms import pendulum

HEADER = "time_s,marker,x_m,y_m,z_m"
ROWS = [f"{0.01 * k:g},tip,0.1,{0.001 * k:g},0" for k in range(20)]
GOOD = "\n".join([HEADER, *ROWS])
WIDE = "\n".join(["time_s,tip_x,tip_y,tip_z", *(f"{0.01 * k:g},0.1,0.2,0" for k in range(20))])


@pytest.fixture
def read(tmp_path):
    """The table in a file of these bytes; the one problem that it is refused with."""

    def read(data, name="tracks"):
        path = tmp_path / "t.csv"
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        try:
            return read_table(name, path, pendulum())
        except DrawingError as error:
            (problem,) = error.problems
            return problem

    return read


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_the_mark_of_a_file_says_how_its_letters_are_written(read, encoding):
    assert list(read(GOOD.encode(encoding))["x_m"]) == [0.1] * 20


REFUSED = {
    "another encoding": (
        GOOD.replace("0.05,tip", "0.05,tïp").encode("latin-1"),
        "byte 0xef in line 7; save it as UTF-8",
    ),
    "semicolons": (
        GOOD.replace(",", ";").replace(".", ","),
        "are separated by semicolons and its numbers have decimal commas; separate values by commas and write numbers",
    ),
    "tabs": (GOOD.replace(",", "\t"), "its values are separated by tabs; separate values by commas, as in time_s,"),
    "a time of another name": (GOOD.replace("time_s", "t"), "lacks column time_s; 't' is likely it: rename it"),
    "a unit in a name": (GOOD.replace("x_m", "X (mm)"), "lacks column x_m; 'X (mm)' is likely it: rename it"),
    "a row for all markers": (
        WIDE,
        "has 3 columns of its own for each marker ('tip_x', 'tip_y', 'tip_z'); write a row for each time and marker",
    ),
    "a marker in capitals": (
        GOOD.replace("tip", "Tip"),
        'marker "Tip" is not drawn; rename it or draw it. Did you mean',
    ),
    "rows without a time": (
        GOOD.replace("0.05,", ",").replace("0.06,", ","),
        "row 7: time_s is empty (2 rows like this); it must be a finite number",
    ),
    "two takes": (
        "\n".join([GOOD, *ROWS]),
        "row 22: time_s goes back from 0.19 s to 0 s; where another take begins there, make it a file",
    ),
    "a clock that is set back": (
        "\n".join([HEADER, *ROWS[:15], *(row.replace("0.1", "0.05", 1) for row in ROWS[8:])]),
        "row 17: time_s goes back from 0.14 s to 0.08 s",
    ),
}


@pytest.mark.parametrize("slip", REFUSED)
def test_a_slip_of_a_whole_table_is_told_once_with_its_remedy(read, slip):
    data, said = REFUSED[slip]
    assert said in read(data)


def test_rows_in_no_order_are_told_one_by_one(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("\n".join([HEADER, *ROWS[::-1]]))
    with pytest.raises(DrawingError) as refusal:
        read_table("tracks", path, pendulum())
    assert len(refusal.value.problems) == 6
    assert "is out of order" in refusal.value.problems[0]


def test_what_several_experiments_have_in_common_is_told_once():
    said = [
        ("e1", "one.csv: row 2: x_m is 7."),
        ("e1", "one.csv: row 3: x_m is 8."),
        ("e2", "two.csv: row 2: x_m is 9.5e-3."),
        ("e2", 'marker "m2" is lost'),
        ("e3", 'marker "m3" is lost'),
    ]
    assert likewise(said) == [
        ("e1", "one.csv: row 2: x_m is 7."),
        ("e1", "one.csv: row 3: x_m is 8; likewise 'e2'"),
        ("e2", 'marker "m2" is lost'),
        ("e3", 'marker "m3" is lost'),
    ]


def test_of_many_experiments_the_first_are_named():
    ((_, sentence),) = likewise((f"run {k}", f"ends at {k} s") for k in range(14))
    assert sentence.startswith("ends at 0 s; likewise 'run 1', 'run 2'")
    assert sentence.endswith("'run 10' and 3 more")
