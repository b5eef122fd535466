"""A folder of files as somebody sent it: only known kinds of files, no path out of it, nothing that swells."""

from __future__ import annotations

import io
import posixpath
import stat
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path

from backend.service.intake.content import refuse_false_content
from backend.service.problems import Problem, disk_full
from backend.service.settings import Settings

SUFFIXES = (
    ".json", ".csv", ".parquet", ".pq", ".stl", ".obj", ".ply", ".glb", ".step", ".stp", ".md", ".txt", ".py",
    ".mp4", ".mov", ".mkv", ".avi", ".webm", ".png", ".jpg", ".jpeg",
)  # fmt: skip
IGNORED = ("__MACOSX/", ".DS_Store", "Thumbs.db")
SWELL = 200  # unpacked over packed size beyond which an entry is a bomb; tables of zeros reach 100
CHUNK = 2**18
DIRECTORY_BYTES = 1024  # of an archive's directory for each file that a folder may hold
MOST_READ = 2**20  # that is asked for at once of anything but the directory


def safe_path(path: str) -> str:
    """A relative path inside the folder, with forward slashes; Problem `invalid` for any other."""
    plain = path.replace("\\", "/")
    parts = plain.split("/")
    faulty = (
        not plain or len(plain) > 300 or plain.startswith("/") or ":" in plain or not plain.isprintable()
        or any(part in ("", ".", "..") or part != part.strip() or len(part.encode()) > 200 for part in parts)
    )  # fmt: skip
    if faulty:
        raise Problem(
            "invalid", f"{path[:100]!r} is not a path inside the folder; send plain names such as meshes/a.stl."
        )
    return posixpath.join(*parts)


def take_folder(files: Mapping[str, Path], settings: Settings) -> dict[str, Path]:
    """The files of a folder, checked, under paths relative to where its mechanism.json or study.json lies.

    files: path as sent -> file on this machine.  Raises Problem.
    """
    taken: dict[str, Path] = {}
    for path, file in files.items():
        if path.endswith(IGNORED) or path.startswith(IGNORED):
            continue
        safe = safe_path(path)
        if not safe.lower().endswith(SUFFIXES):
            raise Problem("wrong-type", f'"{safe}" is not taken here; a folder may hold {", ".join(SUFFIXES)}.')
        if safe.casefold() in (other.casefold() for other in taken):
            raise Problem("invalid", f'"{safe}" is sent twice; keep one.')
        taken[safe] = file
        _refuse_beyond(len(taken), settings.most_files, "files in the folder", settings)
    total = sum(file.stat().st_size for file in taken.values())
    _refuse_beyond(total, settings.largest_folder, "bytes in the folder", settings)
    for path, file in taken.items():
        refuse_false_content(path, file, settings)
    return _from_its_root(taken)


def unpack(archive: Path, into: Path, settings: Settings) -> dict[str, Path]:
    """The files of a zip archive, written under names of our own; Problem on bombs and tricks."""
    into.mkdir(parents=True, exist_ok=True)
    try:
        with (
            _Archive(archive, settings.most_files * DIRECTORY_BYTES) as opened,
            zipfile.ZipFile(opened) as packed,  # pyright: ignore[reportArgumentType]
        ):
            entries = [entry for entry in packed.infolist() if not entry.is_dir()]
            _refuse_beyond(len(entries), settings.most_files, "files in the archive", settings)
            declared = sum(entry.file_size for entry in entries)
            _refuse_beyond(declared, settings.largest_folder, "bytes unpacked", settings)
            files: dict[str, Path] = {}
            room = settings.largest_folder
            for number, entry in enumerate(entries):
                _refuse_tricks(entry)
                path = into / f"{number}"
                room -= _write(packed, entry, path, room)
                if entry.filename in files:
                    raise Problem("invalid", f"{entry.filename[:100]!r} stands twice in the archive; keep one.")
                files[entry.filename] = path
            return files
    except OSError as error:
        if (full := disk_full(error)) is not None:
            raise full from None
        raise _damaged(error) from None
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        raise _damaged(error) from None


def _damaged(error: Exception) -> Problem:
    return Problem("invalid", f"The archive cannot be unpacked ({error}); pack the folder again as zip.")


class _Archive(io.FileIO):
    """An archive whose directory is read into memory, at once, only where it is no larger than so many bytes.

    Whatever the record at its end claims, a reader of archives asks for that much here.
    """

    def __init__(self, path: Path, largest_directory: int):
        super().__init__(path)
        self._most = max(largest_directory, MOST_READ)

    def read(self, size: int | None = -1) -> bytes:
        """The next bytes; Problem `too-large` where more are asked for than a directory may have."""
        if size is not None and size > self._most:
            raise Problem(
                "too-large",
                f"The archive's directory has {size} bytes, above the limit of {self._most}; send fewer files.",
            )
        return super().read(-1 if size is None else size)


def _refuse_tricks(entry: zipfile.ZipInfo) -> None:
    if entry.flag_bits & 0x1:
        raise Problem("invalid", f"{entry.filename[:100]!r} is encrypted; pack the folder without a password.")
    mode = entry.external_attr >> 16
    if mode and stat.S_IFMT(mode) not in (0, stat.S_IFREG):
        raise Problem("invalid", f"{entry.filename[:100]!r} is a link or a device; pack the files themselves.")
    if entry.file_size > 2**20 and entry.file_size > SWELL * max(entry.compress_size, 1):
        times = entry.file_size // max(entry.compress_size, 1)
        raise Problem(
            "too-large", f"{entry.filename[:100]!r} would swell {times} times, beyond {SWELL}; send it unpacked."
        )


def _write(packed: zipfile.ZipFile, entry: zipfile.ZipInfo, path: Path, room: int) -> int:
    """Unpack one entry; what it declares is not believed.  Returns its bytes."""
    size = 0
    with packed.open(entry) as source, path.open("wb") as target:
        while chunk := source.read(CHUNK):
            size += len(chunk)
            if size > min(room, entry.file_size):
                raise Problem("too-large", f"{entry.filename[:100]!r} holds more than it declares; pack it again.")
            target.write(chunk)
    return size


def _from_its_root(files: dict[str, Path]) -> dict[str, Path]:
    """Without the folder's own name, as archives of a folder carry it."""
    tops = {path.partition("/")[0] for path in files}
    while len(tops) == 1 and all("/" in path for path in files):
        files = {path.partition("/")[2]: file for path, file in files.items()}
        tops = {path.partition("/")[0] for path in files}
    return files


def lay_out(files: Mapping[str, Path], folder: Path) -> Path:
    """Links under their paths, so that readers of folders can read it."""
    for path, file in files.items():
        place = folder / path
        place.parent.mkdir(parents=True, exist_ok=True)
        place.symlink_to(file.resolve())
    return folder


def _refuse_beyond(count: int, limit: int, what: str, settings: Settings) -> None:
    if count > limit:
        raise Problem("too-large", f"There are {count} {what}, above the limit of {limit}; send less.")


def names(files: Iterable[str], shown: int = 10) -> str:
    """A few of the names, for a sentence."""
    listed = sorted(files)
    return ", ".join(listed[:shown]) + (f" and {len(listed) - shown} more" if len(listed) > shown else "")
