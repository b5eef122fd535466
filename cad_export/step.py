"""A STEP file as an assembly, and what it lost on the way from the CAD program that wrote it."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cadquery as cq
from OCP.IFSelect import IFSelect_RetDone  # pyright: ignore[reportAttributeAccessIssue]
from OCP.Interface import Interface_Static  # pyright: ignore[reportAttributeAccessIssue]
from OCP.STEPCAFControl import STEPCAFControl_Reader  # pyright: ignore[reportAttributeAccessIssue]
from OCP.TCollection import TCollection_ExtendedString  # pyright: ignore[reportAttributeAccessIssue]
from OCP.TDataStd import TDataStd_Name  # pyright: ignore[reportAttributeAccessIssue]
from OCP.TDF import TDF_Label, TDF_LabelSequence  # pyright: ignore[reportAttributeAccessIssue]
from OCP.TDocStd import TDocStd_Document  # pyright: ignore[reportAttributeAccessIssue]
from OCP.XCAFDoc import XCAFDoc_DocumentTool  # pyright: ignore[reportAttributeAccessIssue]

from backend.mechanism.drawing_error import DrawingError
from cad_export.assembly import GENERATED_NAME

# What translators, and CadQuery, write for want of one.
NO_NAME = re.compile(rf"|\d+|NAUO\d+|=>\[.*\]|Open CASCADE STEP translator.*|{GENERATED_NAME.pattern}")
ALWAYS_LOST = (
    "joints, limits, springs and markers: STEP holds none; joints are proposed from the cylinders",
    "densities: none is read; give each part its own",
    "settings: lengths are as they were written, the script or sketch that made them is gone",
    "which name an occurrence had, where a part stands more than once: some writers mix them up; look at the picture",
)


@dataclass(frozen=True)
class StepFile:
    """assembly: the parts as they stand, in millimetres.  lost: what the file did not bring along, in sentences."""

    assembly: cq.Assembly
    lost: tuple[str, ...]


def read_step(path: str | Path) -> StepFile:
    """Every solid part of a STEP file under a name that occurs once; DrawingError where there is none to read.

    A part keeps its own frame where the file has an assembly. A single part of several solids is an assembly whose
    structure was lost: each solid is then a part, in the file's frame.
    """
    path = Path(path)
    document = _document(path)
    tree = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    assembly, lost = cq.Assembly(name=path.stem), []
    labels = TDF_LabelSequence()
    tree.GetFreeShapes(labels)
    for names, location, shape in _numbered(_leaves(tree, labels, (), cq.Location()), lost):
        assembly.add(shape, name="/".join(names), loc=location)
    if len(assembly.children) == 1 and len(solids := _solids(assembly.children[0])) > 1:
        lost.append(f"the tree of parts: the file is 1 part of {len(solids)} solids; each is taken as a part")
        assembly = cq.Assembly(name=path.stem)
        for number, solid in enumerate(solids, start=1):
            assembly.add(solid, name=f"solid-{number}")
    if not assembly.children:
        raise DrawingError("holds 0 solids; export solid bodies, not sketches or meshes", str(path))
    return StepFile(assembly, (*ALWAYS_LOST, *lost))


def _document(path: Path) -> TDocStd_Document:
    if not path.is_file():
        raise DrawingError("is not a file; check the path", str(path))
    reader = STEPCAFControl_Reader()
    reader.SetNameMode(True)
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")  # whatever unit the file declares is converted to it
    document = TDocStd_Document(TCollection_ExtendedString("step"))
    if reader.ReadFile(str(path)) != IFSelect_RetDone or not reader.Transfer(document):
        raise DrawingError("cannot be read as STEP; export it again as AP203, AP214 or AP242", str(path))
    return document


Leaf = tuple[tuple[str, ...], cq.Location, cq.Shape]


def _leaves(tree: Any, labels: TDF_LabelSequence, names: tuple[str, ...], location: cq.Location) -> Iterator[Leaf]:
    """Names from the root down, absolute place and shape of all that is no assembly, where it holds a solid."""
    for label in labels:
        referred = TDF_Label()
        if not tree.IsReference_s(label) or not tree.GetReferredShape_s(label, referred):
            referred = label
        own, its = _name(label), _name(referred)
        here = (*names, its if NO_NAME.fullmatch(own) else own)
        stands = location * cq.Location(tree.GetLocation_s(label))
        if tree.IsAssembly_s(referred):
            inner = TDF_LabelSequence()
            tree.GetComponents_s(referred, inner)
            yield from _leaves(tree, inner, here, stands)
        elif (shape := cq.Shape.cast(tree.GetShape_s(referred))).Solids():
            yield here, stands, shape


def _numbered(leaves: Iterator[Leaf], lost: list[str]) -> Iterator[Leaf]:
    """Names without the root they share, and with a number where one is missing or stands twice."""
    found = list(leaves)
    while len(found) > 1 and len({names[0] for names, _, _ in found}) == 1 and all(len(n) > 1 for n, _, _ in found):
        found = [(names[1:], location, shape) for names, location, shape in found]
    taken: set[tuple[str, ...]] = set()
    alike: dict[tuple[str, ...], list[str]] = {}
    for names, location, shape in found:
        # CadQuery writes a part as an assembly of one, NAME/NAME_part or NAME/NAME.
        *above, last = names
        if above and last in (above[-1], f"{above[-1]}_part"):
            *above, last = above
        names = (*above, "" if NO_NAME.fullmatch(last) else last)
        clean = tuple("part" if NO_NAME.fullmatch(name) else name.replace("/", "_") for name in names)
        numbers = (clean, *((*clean[:-1], f"{clean[-1]}-{number}") for number in range(2, len(found) + 2)))
        free = next(name for name in numbers if name not in taken)
        taken.add(free)
        alike.setdefault(names, []).append("/".join(free))
        yield free, location, shape
    for names, given in alike.items():
        if not names[-1]:
            whose = "the name of a part, which has" if len(given) == 1 else f"names of {len(given)} parts, which have"
            lost.append(f"{whose} none; here {', '.join(given)}")
        elif len(given) > 1:
            lost.append(f'names of {len(given)} parts, all "{"/".join(names)}" in the file; here {", ".join(given)}')


def _solids(part: cq.Assembly) -> list[cq.Shape]:
    return [solid for shape in part.shapes for solid in shape.moved(part.loc).Solids()]


def _name(label: TDF_Label) -> str:
    name = TDataStd_Name()
    return _readable(name.Get().ToExtString()) if label.FindAttribute(TDataStd_Name.GetID_s(), name) else ""


def _readable(name: str) -> str:
    """A name as it was meant: CadQuery writes the bytes of UTF-8 as letters of their own, and some hold line breaks."""
    with contextlib.suppress(UnicodeError):
        name = name.encode("latin-1").decode("utf-8")
    return " ".join("".join(letter if letter.isprintable() else " " for letter in name).split())
