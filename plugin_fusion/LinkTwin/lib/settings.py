"""What a user sets once: the service's address and key, where exports go, which way is up."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from urllib.parse import urlsplit

UPS = ("auto", "x", "y", "z")
LOCAL = ("localhost", "127.0.0.1", "::1")


class BadSettings(ValueError):
    """A setting cannot be used; says which, and what to write."""


@dataclass(frozen=True)
class Settings:
    """url: of the service, empty to save files only.  key: its API key, empty where it asks for none.

    folder: where exports are saved.  up: the axis against gravity, or `auto` for Fusion's preference.  simulate_s: of
    motion to be simulated at once after an upload [s], 0 for none.
    """

    url: str = "http://127.0.0.1:8000"
    key: str = ""
    folder: str = str(Path.home() / "LinkTwin")
    up: str = "auto"
    simulate_s: float = 0.0

    def checked(self) -> Settings:
        """The same, trimmed; BadSettings where one cannot be used."""
        url, key, folder = self.url.strip().rstrip("/"), self.key.strip(), self.folder.strip()
        if url:
            try:
                parts = urlsplit(url)
                known = parts.scheme in ("http", "https") and bool(parts.hostname)
                parts.port  # noqa: B018  # raises where it is no number
            except ValueError:
                known = False
            if not known or parts.username or parts.query or parts.fragment:
                raise BadSettings(f'the address "{url}" is no http:// or https:// address; write http://127.0.0.1:8000')
            if key and parts.scheme == "http" and parts.hostname not in LOCAL:
                raise BadSettings(f'the key would travel unencrypted to "{parts.hostname}"; write https:// there')
        if not key.isascii() or not key.isprintable() or " " in key:
            raise BadSettings("the key holds a space or a letter that no key has; copy it again")
        if not folder:
            raise BadSettings("the folder is empty; choose where exports are saved")
        if self.up not in UPS:
            raise BadSettings(f'up is "{self.up}"; write one of {", ".join(UPS)}')
        if not 0.0 <= self.simulate_s <= 3600.0:
            raise BadSettings(f"simulate_s is {self.simulate_s:g}; write 0 to 3600 seconds")
        return replace(self, url=url, key=key, folder=folder)


def settings_path() -> Path:
    """~/.linktwin/fusion.json, or what LINKTWIN_FUSION_SETTINGS says."""
    return Path(os.environ.get("LINKTWIN_FUSION_SETTINGS") or Path.home() / ".linktwin" / "fusion.json")


def load(path: Path) -> Settings:
    """The settings in a file, or the defaults where there is none; BadSettings naming the file otherwise."""
    try:
        told = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return Settings()
    except (OSError, ValueError) as error:
        raise BadSettings(f"{path} cannot be read ({error}); correct it, or delete it to begin anew") from None
    try:
        return _from(told).checked()
    except BadSettings as error:
        raise BadSettings(f"{path}: {error}") from None


def store(settings: Settings, path: Path) -> None:
    """Write the settings, readable by this user alone: they hold the key."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(asdict(settings), indent=1, ensure_ascii=False) + "\n"
    new = path.with_name(path.name + ".new")
    new.unlink(missing_ok=True)
    with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write(text)
    os.replace(new, path)


def _from(told: object) -> Settings:
    if not isinstance(told, Mapping):
        raise BadSettings("holds no object in braces; delete it to begin anew")
    known = {field.name for field in fields(Settings)}
    if unknown := sorted(set(told) - known):
        raise BadSettings(f"{unknown[0]!r} is no setting; there are {', '.join(sorted(known))}")
    for name, value in told.items():
        right = (
            isinstance(value, (int, float)) and not isinstance(value, bool)
            if name == "simulate_s"
            else isinstance(value, str)
        )
        if not right:
            raise BadSettings(f"{name} is {value!r}; write {'a number' if name == 'simulate_s' else 'text'}")
    return Settings(**told)
