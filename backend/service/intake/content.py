"""Whether a file holds what its name says: the first bytes decide, and sizes that a header claims are checked."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from pathlib import Path

from backend.service.problems import Problem
from backend.service.settings import Settings

HEAD = 4096
VIDEO = (".mp4", ".mov", ".mkv", ".webm", ".avi")
MOST_BOXES = 10_000


def refuse_false_content(path: str, file: Path, settings: Settings) -> None:
    """Problem where a file is not what its suffix says, or claims more than it holds.

    path: the name it was sent under; file: where it lies.
    """
    suffix = "." + path.rpartition(".")[2].lower()
    if (check := CHECKS.get(suffix)) is not None and (fault := check(file, settings)):
        raise Problem("invalid", f'"{path}" {fault}.')


def video_suffix(file: Path) -> str:
    """The suffix that a video's content asks for; Problem `wrong-type` where it is no video.

    An MP4 or MOV must hold its index (`moov`): without it nothing can be decoded.
    """
    with file.open("rb") as opened:
        head = opened.read(HEAD)
    if head[4:8] == b"ftyp" or head[4:8] in (b"moov", b"mdat", b"wide", b"free", b"skip"):
        if fault := _boxes(file):
            raise Problem("invalid", f"The video {fault}; copy it again from the camera.")
        return ".mov" if head[8:12] == b"qt  " else ".mp4"
    if head[:4] == b"\x1a\x45\xdf\xa3":
        return ".webm" if b"webm" in head[:64] else ".mkv"
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        return ".avi"
    begins = head[:16].hex(" ") or "nothing"
    raise Problem(
        "wrong-type", f"This is no MP4, MOV, MKV, WebM or AVI (it begins with {begins}); send the camera's own file."
    )


def _boxes(file: Path) -> str | None:
    """Walk the boxes of an MP4: what is wrong, or None."""
    size, at, seen = file.stat().st_size, 0, []
    with file.open("rb") as opened:
        while at + 8 <= size and len(seen) < MOST_BOXES:
            opened.seek(at)
            length, kind = struct.unpack(">I4s", opened.read(8))
            if length == 1:
                wide = opened.read(8)
                length = struct.unpack(">Q", wide)[0] if len(wide) == 8 else 0
            elif length == 0:
                length = size - at
            if length < 8 or not kind.isascii():
                return f"has a damaged box at byte {at}"
            seen.append(kind)
            at += length
            if kind == b"moov" and at > size:
                return f"ends inside its index (moov), which takes {length} bytes"
    return None if b"moov" in seen else "has no index (moov): its recording was cut off, or it is no MP4"


def _mesh_stl(file: Path, settings: Settings) -> str | None:
    size = file.stat().st_size
    with file.open("rb") as opened:
        head = opened.read(HEAD)
    if head.lstrip().lower().startswith(b"solid") and b"\0" not in head and (b"facet" in head or size < HEAD):
        return None
    if size < 84:
        return f"is no STL: {size} bytes are less than its header of 84"
    triangles = struct.unpack("<I", head[80:84])[0]
    if size != 84 + 50 * triangles:
        return f"claims {triangles} triangles, which take {84 + 50 * triangles} bytes, and has {size}; export it again"
    return None


def _mesh_ply(file: Path, settings: Settings) -> str | None:
    size = file.stat().st_size
    with file.open("rb") as opened:
        head = opened.read(HEAD)
    if not head.startswith(b"ply"):
        return "is no PLY: its first line is not `ply`"
    for kind, count in re.findall(rb"element (\w+) (\d+)", head):
        if int(count) > size:
            return f"claims {int(count)} elements {kind.decode()!r} in {size} bytes; export it again"
    return None


def _mesh_obj(file: Path, settings: Settings) -> str | None:
    with file.open("rb") as opened:
        return "holds bytes of zero, which an OBJ never does; export it again" if b"\0" in opened.read(HEAD) else None


def _mesh_glb(file: Path, settings: Settings) -> str | None:
    size = file.stat().st_size
    with file.open("rb") as opened:
        head = opened.read(12)
    if len(head) < 12 or head[:4] != b"glTF":
        return "is no GLB: it does not begin with glTF"
    claimed = struct.unpack("<I", head[8:12])[0]
    return None if claimed == size else f"claims {claimed} bytes and has {size}; export it again"


def _document(file: Path, settings: Settings) -> str | None:
    size = file.stat().st_size
    if size > settings.largest_document:
        raise Problem("too-large", f"A document has {size} bytes, above the limit of {settings.largest_document}.")
    return None


def _table_csv(file: Path, settings: Settings) -> str | None:
    size = file.stat().st_size
    if size > settings.largest_table:
        raise Problem(
            "too-large", f"A table has {size} bytes, above the limit of {settings.largest_table}; thin it out."
        )
    with file.open("rb") as opened:
        return "holds bytes of zero, which a table never does; save it as UTF-8" if b"\0" in opened.read(HEAD) else None


def _table_parquet(file: Path, settings: Settings) -> str | None:
    if file.stat().st_size > settings.largest_table:
        raise Problem("too-large", f"A table has more than {settings.largest_table} bytes; thin it out.")
    from pyarrow import ArrowException
    from pyarrow.parquet import read_metadata

    try:
        told = read_metadata(file)
    except (ArrowException, OSError, ValueError) as error:
        return f"cannot be read as Parquet ({str(error)[:200]}); write it again"
    size = sum(told.row_group(group).total_byte_size for group in range(told.num_row_groups))
    if told.num_rows > settings.most_rows or told.num_columns > 64 or size > 8 * settings.largest_table:
        raise Problem(
            "too-large",
            f"A table has {told.num_rows} rows, {told.num_columns} columns and {size} bytes unpacked; "
            f"the limits are {settings.most_rows} rows, 64 columns and {8 * settings.largest_table} bytes.",
        )
    return None


def _begins(*heads: bytes) -> Callable[[Path, Settings], str | None]:
    def check(file: Path, settings: Settings) -> str | None:
        with file.open("rb") as opened:
            return None if opened.read(8).startswith(heads) else "is not a picture of the kind that its name says"

    return check


def _film(file: Path, settings: Settings) -> str | None:
    video_suffix(file)
    return None


CHECKS: dict[str, Callable[[Path, Settings], str | None]] = {
    ".json": _document, ".csv": _table_csv, ".parquet": _table_parquet, ".pq": _table_parquet,
    ".stl": _mesh_stl, ".ply": _mesh_ply, ".obj": _mesh_obj, ".glb": _mesh_glb,
    ".png": _begins(b"\x89PNG"), ".jpg": _begins(b"\xff\xd8\xff"), ".jpeg": _begins(b"\xff\xd8\xff"),
    **dict.fromkeys(VIDEO, _film),
}  # fmt: skip
