"""Elements of a view: plain HTML that works by keyboard on its own, dressed by style.css."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from nicegui import ui
from nicegui.element import Element
from nicegui.elements.mixins.text_element import TextElement

from backend.service.page.late import ROOT


def tag(name: str, text: str = "", look: str = "", **attributes: Any) -> Element:
    """An HTML element with a text, classes and attributes; underscores in attribute names are dashes."""
    element = TextElement(tag=name, text=text) if text else Element(name)
    if look:
        element.classes(look)
    for key, value in attributes.items():
        if value is not None:
            element.props[key.rstrip("_").replace("_", "-")] = value
    return element


def link(text: str, address: str, look: str = "", **attributes: Any) -> Element:
    """A link; an address that begins with / is one of the page's own, with or without the place where it is mounted."""
    own = address.startswith("/") and not address.startswith(f"{ROOT}/")
    return tag("a", text, look, href=ROOT + address if own else address, **attributes)


def button(text: str, pressed: Callable[..., Any] | None = None, look: str = "act", **attributes: Any) -> Element:
    """A button."""
    made = tag("button", text, look, type="button", **attributes)
    if pressed is not None:
        made.on("click", pressed)
    return made


def drawn(markup: str, look: str = "") -> Element:
    """Markup that this program made itself."""
    return ui.html(markup, sanitize=False).classes(look)


def enable(element: Element, on: bool) -> None:
    """Let a button be pressed, or not."""
    if on:
        element.props(remove="disabled")
    else:
        element.props("disabled")


def notice(sentences: Sequence[str], look: str, lead: str = "") -> None:
    """A box of sentences: `warn`, `bad` or `good`; nothing where there are none."""
    if not sentences and not lead:
        return
    with tag("div", look=f"notice {look}", role="alert" if look == "bad" else "note"):
        if lead:
            tag("b", lead)
        if len(sentences) == 1:
            tag("p", sentences[0])
        elif sentences:
            with tag("ul"):
                for sentence in sentences:
                    tag("li", sentence)


def figures(items: Iterable[Sequence[str]]) -> None:
    """Numbers at a glance: (value, what it means)."""
    with tag("div", look="figures"):
        for value, meaning in items:
            with tag("div"):
                tag("b", value)
                tag("span", meaning)


def facts(rows: Iterable[tuple[str, str]]) -> None:
    """Names and values, one a line."""
    with tag("dl", look="facts"):
        for name, value in rows:
            tag("dt", name)
            tag("dd", value)


def empty(title: str, sentence: str) -> Element:
    """An empty state: what is missing, and what to do; further elements may stand in it."""
    box = tag("div", look="empty")
    with box:
        tag("b", title)
        tag("p", sentence)
    return box


def field(
    label: str, value: Any, changed: Callable[[Any], None], kind: str = "text", when: str = "input", **attributes: Any
) -> Element:
    """A labelled input; `changed` is told its text at every letter, or when it is complete (when: "change")."""
    with tag("label", look="field"):
        tag("span", label)
        made = tag("input", look="in", type=kind, value=value, **attributes)
        made.on(when, lambda event: changed(event.args), js_handler="(e) => emit(e.target.value)")
    return made


def choice(
    label: str, options: Sequence[tuple[str, str]], value: str, changed: Callable[[str], None], **attributes: Any
) -> Element:
    """A labelled list to choose from: (value, text); `changed` is told the value."""
    with tag("label", look="field"):
        tag("span", label)
        made = tag("select", look="in", **attributes)
        with made:
            for key, text in options:
                tag("option", text, value=key, selected=True if key == value else None)
        made.on("change", lambda event: changed(event.args), js_handler="(e) => emit(e.target.value)")
    return made


def tick(label: str, value: bool, changed: Callable[[bool], None]) -> Element:
    """A labelled box to tick."""
    with tag("label", look="field row"):
        made = tag("input", type="checkbox", checked=True if value else None)
        made.on("change", lambda event: changed(bool(event.args)), js_handler="(e) => emit(e.target.checked)")
        tag("span", label)
    return made
