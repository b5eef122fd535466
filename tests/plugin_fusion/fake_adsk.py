"""The `adsk` package and Fusion's user interface, as far as the buttons ask them.

Fusion breaks when it is spoken to from another thread than its own: here that raises, but for `fireCustomEvent`.
"""

import json
import threading
import time
from types import ModuleType, SimpleNamespace
from typing import Any

from tests.plugin_fusion import fakes

HANDLERS = ("CommandCreatedEventHandler", "CommandEventHandler", "CustomEventHandler", "HTMLEventHandler")


class Event:
    """Calls its handlers."""

    def __init__(self):
        self.handlers: list[Any] = []

    def add(self, handler) -> bool:
        self.handlers.append(handler)
        return True

    def fire(self, args) -> None:
        for handler in self.handlers:
            handler.notify(args)


class Shelf:
    """Things by id that can be added and deleted."""

    def __init__(self):
        self.things: dict[str, Any] = {}

    def put(self, id: str, thing: Any) -> Any:
        if id in self.things:
            raise RuntimeError(f"3 : {id} is there already")
        thing.id = id
        thing.deleteMe = lambda: bool(self.things.pop(id))
        self.things[id] = thing
        return thing

    def itemById(self, id: str) -> Any:
        return self.things.get(id)


class Inputs(Shelf):
    """Command inputs of a dialog."""

    def addStringValueInput(self, id: str, words: str, value: str) -> Any:
        return self.put(id, SimpleNamespace(value=value))

    def addDropDownCommandInput(self, id: str, words: str, style: int) -> Any:
        drop_down = self.put(id, SimpleNamespace(selectedItem=None, words=[]))

        def add(name: str, chosen: bool) -> None:
            drop_down.words.append(name)
            if chosen:
                drop_down.selectedItem = SimpleNamespace(name=name)

        drop_down.listItems = SimpleNamespace(add=add)
        return drop_down


class Palette(SimpleNamespace):
    """A palette; what it was sent is in `seen`."""

    def __init__(self, url: str):
        super().__init__(url=url, isVisible=True, dockingState=None, incomingFromHTML=Event(), seen=[])

    def sendInfoToHTML(self, action: str, data: str) -> str:
        self.seen.append(json.loads(data))
        return "OK"

    def say(self, action: str, **data: Any) -> None:
        """Something that its page says."""
        self.incomingFromHTML.fire(SimpleNamespace(action=action, data=json.dumps(data)))


class FakeFusion:
    """A running Fusion with one design open."""

    def __init__(self, product: Any = None, **told: Any):
        self._main = threading.get_ident()
        self._fired: list[tuple[str, str]] = []
        self._events: dict[str, Event] = {}
        self.boxes: list[str] = []
        self.controls, self.definitions, self.palettes = Shelf(), Shelf(), Shelf()
        self.palettes.add = self._add_palette
        self._data = {**vars(fakes.application(**told)), "activeProduct": product, "userInterface": self._interface()}

    def __getattr__(self, name: str) -> Any:
        self._mine(name)
        return getattr(fakes.Fake(**self._data), name)

    def _mine(self, what: str) -> None:
        if threading.get_ident() != self._main:
            raise RuntimeError(f"{what} is asked from a thread that is not Fusion's")

    def fireCustomEvent(self, id: str, text: str = "") -> bool:
        self._fired.append((id, text))
        return True

    def registerCustomEvent(self, id: str) -> Event:
        self._mine("registerCustomEvent")
        return self._events.setdefault(id, Event())

    def unregisterCustomEvent(self, id: str) -> bool:
        self._mine("unregisterCustomEvent")
        return self._events.pop(id, None) is not None

    def deliver(self, until, patience_s: float = 20.0) -> None:
        """Deliver what was fired, as Fusion does when it is idle, until something is so."""
        end = time.monotonic() + patience_s
        while not until():
            if self._fired:
                id, text = self._fired.pop(0)
                if id in self._events:
                    self._events[id].fire(SimpleNamespace(additionalInfo=text))
            elif time.monotonic() > end:
                raise AssertionError(f"nothing came in {patience_s:g} s")
            else:
                time.sleep(1e-3)  # lets the other thread run

    def press(self, id: str) -> Any:
        """Press a button; the arguments of the command, which has been executed where it has no inputs."""
        command = SimpleNamespace(commandInputs=Inputs(), execute=Event())
        self.definitions.things[id].commandCreated.fire(SimpleNamespace(command=command))
        args = SimpleNamespace(command=command, executeFailed=False, executeFailedMessage="")
        if not command.commandInputs.things:
            command.execute.fire(args)
        return args

    @property
    def palette(self) -> Palette:
        (palette,) = self.palettes.things.values()
        return palette

    def _interface(self) -> Any:
        def add_button(id: str, name: str, tip: str) -> Any:
            return self.definitions.put(id, SimpleNamespace(name=name, commandCreated=Event()))

        self.definitions.addButtonDefinition = add_button
        self.controls.addCommand = lambda definition: self.controls.put(
            definition.id, SimpleNamespace(isPromoted=False)
        )
        panels = SimpleNamespace(itemById={"SolidScriptsAddinsPanel": SimpleNamespace(controls=self.controls)}.get)
        workspaces = SimpleNamespace(itemById={"FusionSolidEnvironment": SimpleNamespace(toolbarPanels=panels)}.get)
        return SimpleNamespace(
            commandDefinitions=self.definitions,
            workspaces=workspaces,
            palettes=self.palettes,
            messageBox=lambda text, title="": self.boxes.append(text),
        )

    def _add_palette(self, id, name, url, visible, closes, resizes, width, height, new_browser) -> Palette:
        return self.palettes.put(id, Palette(url))

    def modules(self) -> dict[str, ModuleType]:
        """`adsk`, `adsk.core` and `adsk.fusion` for sys.modules."""
        adsk, core, fusion = ModuleType("adsk"), ModuleType("adsk.core"), ModuleType("adsk.fusion")

        def get() -> FakeFusion:
            self._mine("Application.get")
            return self

        core.Application = SimpleNamespace(get=get)  # type: ignore[attr-defined]
        for handler in HANDLERS:
            setattr(core, handler, type(handler, (), {}))
        core.DropDownStyles = SimpleNamespace(TextListDropDownStyle=1)  # type: ignore[attr-defined]
        core.PaletteDockingStates = SimpleNamespace(PaletteDockStateRight=2)  # type: ignore[attr-defined]
        fusion.Design = SimpleNamespace(cast=lambda product: product)  # type: ignore[attr-defined]
        adsk.core, adsk.fusion, adsk.doEvents = core, fusion, lambda: None  # type: ignore[attr-defined]
        return {"adsk": adsk, "adsk.core": core, "adsk.fusion": fusion}
