"""What a job was about: its drawing, and where that lies among what is stored."""

from __future__ import annotations

from dataclasses import dataclass

from backend.mechanism.body import SURFACES
from backend.mechanism.mechanism import Mechanism
from backend.service.mechanisms import DRAWING, parse_drawing
from backend.service.page.study_view import read_stored_study
from backend.service.records import Job
from backend.service.service import Service
from backend.service.things import file_of


@dataclass(frozen=True)
class Subject:
    """A stored drawing.  folder: where its mechanism.json lies among the files of the thing `id`."""

    room: str
    id: str
    mechanism: Mechanism
    folder: str = ""

    def path(self, uri: str) -> str:
        """Where a mesh of the drawing lies among the files."""
        return f"{self.folder}/{uri}".lstrip("/")

    def meshes(self) -> set[str]:
        """Paths of the meshes that the stage asks for."""
        uris = {mesh.uri for body in self.mechanism.bodies for mesh in body.meshes}
        return {self.path(uri) for uri in uris if uri.lower().endswith(SURFACES)}


def subject_of(service: Service, job: Job) -> Subject:
    """The drawing that a job was about; Problem `not-found` where it was deleted since."""
    if id := job.request.get("study"):
        file, mechanism = read_stored_study(service, id)
        return Subject("studies", id, mechanism, file.mechanism.rpartition("/")[0])
    id = job.request["mechanism"]
    return Subject("mechanisms", id, parse_drawing(service, service.storage.read(file_of(service, id, DRAWING).key)))
