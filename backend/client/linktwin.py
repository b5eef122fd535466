"""A linktwin service, as Python asks it."""

from __future__ import annotations

import hashlib
import time
import uuid
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import IO, Any, Literal
from urllib.parse import quote

import httpx

from backend.client.events import data_of
from backend.client.line import CHUNK, CONNECT_S, Line, attempt, parsed, pieces, read
from backend.client.packing import DRAWING, bed_told, drawing_files, packed, study_files, told
from backend.client.problem import ServiceProblem, not_ours
from backend.mechanism.study import StudyFile
from backend.service.answers import ROOMS, FileAnswer, JobAnswer, ProgressAnswer, ResultAnswer, ThingAnswer
from backend.service.states import FINISHED, Kind

ZIP, BYTES = "application/zip", "application/octet-stream"
SILENCE_S = 40.0  # the service pings its listeners every 15 s
POLL_S = 1.0
PATIENCE_S = 120.0  # how long a service that is followed may be away
Told = Callable[[ProgressAnswer], None]
Sent = Callable[[float], None]


def _nobody(_: object) -> None:
    pass


class Linktwin:
    """A service at an address, asked with a key where it wants one.

    A mechanism, study, clip or job is named by its answer or by its id.  What is asked for is asked again after a
    break of the line: an idempotency key keeps a job from being started twice, and an upload from being stored twice.
    repeat_key: one's own, under which a program that was ended may ask again; made up otherwise.  Raises
    ServiceProblem.
    """

    def __init__(self, url: str, key: str | None = None):
        self._line = Line(url, key)
        self._welcome = False

    def __enter__(self) -> Linktwin:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close its connections."""
        self._line.http.close()

    # What is stored

    def store_mechanism(
        self, drawing: Path | str, name: str | None = None, sent: Sent = _nobody, repeat_key: str | None = None
    ) -> ThingAnswer:
        """Store a mechanism.json, or the one in a folder, with its meshes.

        sent: told the part of the upload that has gone.  Raises DrawingError too.
        """
        path = Path(drawing)
        files = drawing_files(path / DRAWING if path.is_dir() else path)
        return self._store_folder("mechanism", files, name, sent, repeat_key)

    def store_study(
        self, study: Path | str | StudyFile, folder: Path | str | None = None, name: str | None = None,
        sent: Sent = _nobody, repeat_key: str | None = None,
    ) -> ThingAnswer:  # fmt: skip
        """Store a study.json with all that it names: mechanism and meshes, tracks and other tables, cameras, clips.

        folder: what its paths are relative to, its own folder where nothing is said.  Raises DrawingError too.
        """
        if not isinstance(study, StudyFile):
            study = Path(study)
            folder = study.parent if folder is None else folder
        return self._store_folder("study", study_files(study, Path(folder or ".")), name, sent, repeat_key)

    def compose_study(
        self, document: Mapping[str, Any] | StudyFile, name: str | None = None, repeat_key: str | None = None
    ) -> ThingAnswer:
        """Store a study of what is stored already: `mechanisms/ID`, `videos/ID`, `jobs/ID/files/tracks.csv`."""
        study = document.model_dump(mode="json", exclude_none=True) if isinstance(document, StudyFile) else document
        answer = self._line.ask(
            "POST", "/studies", json=dict(study), params=_given(name=name), headers=_repeatable(repeat_key)
        )
        return read(ThingAnswer, answer)

    def store_clip(
        self, clip: Path | str, name: str | None = None, sent: Sent = _nobody, repeat_key: str | None = None
    ) -> ThingAnswer:
        """Store a clip, streamed."""
        path = Path(clip)
        with path.open("rb") as file:
            return self._store("PUT", "/videos", file, path.stat().st_size, BYTES, name or path.stem, sent, repeat_key)

    def thing(self, kind: Kind, id: str) -> ThingAnswer:
        """A stored mechanism, study or clip, and its files."""
        return read(ThingAnswer, self._line.ask("GET", f"/{ROOMS[kind]}/{_id(id)}"))

    # Work

    def simulate(
        self,
        mechanism: ThingAnswer | str,
        *,
        duration_s: float = 1.0,
        step_s: float = 1e-3,
        solve: Literal["compliance", "reduced"] = "compliance",
        threshold: float | None = None,
        repeat_key: str | None = None,
    ) -> JobAnswer:
        """Let a stored mechanism go: `linktwin simulate`."""
        return self.start(
            {"kind": "simulate", "mechanism": _id(mechanism), "duration_s": duration_s, "step_s": step_s,
             "solve": solve, "threshold": threshold}, repeat_key,
        )  # fmt: skip

    def jam(
        self,
        *,
        mechanism: ThingAnswer | str | None = None,
        study: ThingAnswer | str | None = None,
        duration_s: float | None = None,
        step_s: float = 1e-3,
        samples: int | None = None,
        vary: Sequence[str] = (),
        seed: int = 0,
        repeat_key: str | None = None,
    ) -> JobAnswer:
        """Whether it jams, from the drawn pose or from each experiment's start: `linktwin jam`."""
        return self.start(
            {"kind": "jam", "mechanism": mechanism and _id(mechanism), "study": study and _id(study),
             "duration_s": duration_s, "step_s": step_s, "samples": samples, "vary": list(vary), "seed": seed},
            repeat_key,
        )  # fmt: skip

    def fit(
        self,
        study: ThingAnswer | str,
        *,
        free: Sequence[str],
        optimiser: Literal["lm", "lbfgsb"] = "lm",
        loss: Literal["linear", "soft_l1", "huber", "student"] = "linear",
        noise: Literal["white", "ar1"] = "white",
        starts: int = 0,
        sparse: bool = False,
        step_s: float | None = None,
        repeat_key: str | None = None,
    ) -> JobAnswer:
        """Fit what the drawing leaves open: `linktwin fit`."""
        return self.start(
            {"kind": "fit", "study": _id(study), "free": list(free), "optimiser": optimiser, "loss": loss,
             "noise": noise, "starts": starts, "sparse": sparse, "step_s": step_s}, repeat_key,
        )  # fmt: skip

    def diagnose(
        self,
        study: ThingAnswer | str,
        *,
        tolerance_mm: float | None = None,
        without: Sequence[str] = (),
        minutes: float | None = None,
        repeat_key: str | None = None,
    ) -> JobAnswer:
        """Say why the real one differs: `linktwin diagnose`."""
        return self.start(
            {"kind": "diagnose", "study": _id(study), "tolerance_mm": tolerance_mm, "without": list(without),
             "minutes": minutes}, repeat_key,
        )  # fmt: skip

    def track(
        self,
        video: ThingAnswer | str,
        mechanism: ThingAnswer | str,
        *,
        bed: Path | str | Mapping[str, Any] | Sequence[Any],
        clicks: Path | str | Mapping[str, tuple[float, float]] | None = None,
        targets: Path | str | Mapping[str, int | str] | None = None,
        from_s: float = 0.0,
        to_s: float | None = None,
        filmed_per_s: float | None = None,
        keep_truncated: bool = False,
        coast_s: float = 0.0,
        repeat_key: str | None = None,
    ) -> JobAnswer:
        """Measure where the markers went in a clip: `linktwin track`.

        bed, clicks, targets: what the command's files hold, or the files.  Raises DrawingError for one that is no JSON.
        """
        return self.start(
            {"kind": "track", "video": _id(video), "mechanism": _id(mechanism), "bed": bed_told(bed),
             "clicks": told(clicks), "targets": told(targets), "from_s": from_s, "to_s": to_s,
             "filmed_per_s": filmed_per_s, "keep_truncated": keep_truncated, "coast_s": coast_s},
            repeat_key,
        )  # fmt: skip

    def start(self, request: Mapping[str, Any], repeat_key: str | None = None) -> JobAnswer:
        """Ask for work, as backend/service/jobs/requests.py has it."""
        return read(JobAnswer, self._line.ask("POST", "/jobs", json=dict(request), headers=_repeatable(repeat_key)))

    def job(self, job: JobAnswer | str) -> JobAnswer:
        """A job as it stands."""
        return read(JobAnswer, self._line.ask("GET", f"/jobs/{_id(job)}"))

    def events(self, job: JobAnswer | str, silence_s: float = SILENCE_S) -> Generator[ProgressAnswer]:
        """How far a job is, now and at every change, until it has finished or the line breaks."""
        waiting = httpx.Timeout(silence_s, connect=CONNECT_S)
        with self._line.stream("GET", f"/jobs/{_id(job)}/events", timeout=waiting) as answer:
            if not answer.headers.get("content-type", "").startswith("text/event-stream"):
                raise not_ours(answer.url, "no stream of events", answer.status_code)
            for data in data_of(answer.iter_lines()):
                yield parsed(ProgressAnswer, data, answer)

    def wait(self, job: JobAnswer | str, told: Told = _nobody, longest_s: float | None = None) -> JobAnswer:
        """Wait for a job's end, however it ended; a line that breaks is taken up again, and polled where it is silent.

        told: how far it is, at every change.  Raises TimeoutError after `longest_s`, while the job goes on.
        """
        heard = time.monotonic()
        end = heard + longest_s if longest_s is not None else float("inf")
        follow = True
        while True:
            if follow:
                heard, follow = self._follow(job, told, heard, end)
            try:
                found = self.job(job)
            except ServiceProblem as problem:
                if not problem.passing or time.monotonic() - heard > PATIENCE_S:
                    raise
            else:
                heard = time.monotonic()
                told(ProgressAnswer.model_validate(found, from_attributes=True))
                if found.state in FINISHED:
                    return found
            if time.monotonic() > end:
                raise TimeoutError(f"job {_id(job)} has not ended within {longest_s:g} s; it goes on")
            time.sleep(POLL_S)

    def _follow(self, job: JobAnswer | str, told: Told, heard: float, end: float) -> tuple[float, bool]:
        """Listen to the events while they come; when something was heard last, and whether listening is worth it."""
        silence_s = max(0.1, min(SILENCE_S, end - time.monotonic()))
        came = False
        try:
            with closing(self.events(job, silence_s)) as events:
                for progress in events:
                    came, heard = True, time.monotonic()
                    told(progress)
                    if heard > end:
                        break
        except ServiceProblem as problem:
            silent = isinstance(problem.__cause__, httpx.ReadTimeout) and not came  # a proxy that holds events back
            return heard, problem.passing and not silent
        return heard, True

    def cancel(self, job: JobAnswer | str) -> JobAnswer:
        """End a job; one that has finished stays as it is."""
        return read(JobAnswer, self._line.ask("DELETE", f"/jobs/{_id(job)}"))

    # Results

    def result(self, job: JobAnswer | str) -> ResultAnswer:
        """What a finished job found: its command's report, and the files it wrote."""
        return read(ResultAnswer, self._line.ask("GET", f"/jobs/{_id(job)}/result"))

    def files(self, job: JobAnswer | str) -> list[FileAnswer]:
        """What a job wrote."""
        return read(list[FileAnswer], self._line.ask("GET", f"/jobs/{_id(job)}/files"))

    def download(self, job: JobAnswer | str, folder: Path | str, without: Sequence[str] = ()) -> list[Path]:
        """Write what a job wrote into a folder, each file whole or not at all; where they lie.

        without: paths to leave out.
        """
        root = Path(folder).resolve()
        written = []
        for file in self.files(job):
            place = (root / file.path).resolve()
            if not place.is_relative_to(root):
                raise not_ours(self._line.url, f"with a file {file.path!r}, outside the folder")
            if file.path not in without:
                place.parent.mkdir(parents=True, exist_ok=True)
                attempt(lambda file=file, place=place: self._fetch(f"/jobs/{_id(job)}/files", file, place))
                written.append(Path(folder) / file.path)
        return written

    def _fetch(self, room: str, file: FileAnswer, place: Path) -> None:
        part = place.with_name(f".{place.name}.part")
        digest = hashlib.sha256()
        try:
            with self._line.stream("GET", f"{room}/{quote(file.path)}") as answer, part.open("wb") as target:
                for chunk in answer.iter_bytes(CHUNK):
                    digest.update(chunk)
                    target.write(chunk)
            if digest.hexdigest() != file.sha256:
                raise ServiceProblem("A file came changed", f"{file.path} is not what was stored; download it again.")
            part.replace(place)
        finally:
            part.unlink(missing_ok=True)

    def delete(self, what: ThingAnswer | JobAnswer) -> None:
        """Delete a stored thing and its files, or a job and what it wrote; a job under way is cancelled first."""
        room = "jobs" if isinstance(what, JobAnswer) else ROOMS[what.kind]
        forget = {"forget": "true"} if room == "jobs" else {}
        try:
            self._line.ask("DELETE", f"/{room}/{what.id}", params=forget)
        except ServiceProblem as problem:
            if problem.kind != "not-found":  # gone is gone: perhaps the first answer was lost
                raise

    def page(self, what: ThingAnswer | JobAnswer) -> str:
        """The address of its page."""
        room = "jobs" if isinstance(what, JobAnswer) else ROOMS[what.kind]
        return f"{self._line.url}/ui/{room}/{what.id}"

    def _store_folder(
        self, kind: Kind, files: Mapping[str, Path | bytes], name: str | None, sent: Sent, repeat_key: str | None
    ) -> ThingAnswer:
        with packed(files) as archive:
            size = archive.seek(0, 2)
            return self._store("POST", f"/{ROOMS[kind]}", archive, size, ZIP, name, sent, repeat_key)

    def _store(
        self, method: str, path: str, file: IO[bytes], size: int, kind: str, name: str | None, sent: Sent,
        repeat_key: str | None,
    ) -> ThingAnswer:  # fmt: skip
        if not self._welcome:  # a key that is refused is better told before a large upload than after it
            self._line.ask("GET", "/jobs", params={"limit": 1})
            self._welcome = True
        headers = {"Content-Type": kind, "Content-Length": str(size), **_repeatable(repeat_key)}

        def once() -> httpx.Response:
            file.seek(0)
            content = pieces(file, size, sent)
            return self._line.once(method, path, content=content, headers=headers, params=_given(name=name))

        return read(ThingAnswer, attempt(once))


def _id(what: ThingAnswer | JobAnswer | str) -> str:
    return quote(what, safe="") if isinstance(what, str) else what.id


def _repeatable(repeat_key: str | None) -> dict[str, str]:
    return {"Idempotency-Key": repeat_key or str(uuid.uuid4())}


def _given(**options: str | None) -> dict[str, str]:
    return {name: value for name, value in options.items() if value is not None}
