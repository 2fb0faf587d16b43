"""What an operator must hear of at once, in a sentence: without a screen, and at one."""

from __future__ import annotations

from drivers.events import (
    Alarm,
    Event,
    HostVented,
    InstrumentFault,
    LinkLost,
    LinkRestored,
    VentConfirmed,
)


def outage_words(event: Event) -> str | None:
    """Return the sentence for an event of which the operator must know at once, else None."""
    match event:
        case LinkLost(reason):
            return f"{reason}; looking for it"
        case LinkRestored(outage_s):
            return (
                f"the link is back after {outage_s:.1f} s; a curve that it cut is kept as a "
                "partial one, and taken again"
            )
        case Alarm(text):
            return f"ALARM: {text}"
        case _:
            return None


def event_note(event: Event) -> tuple[str, str] | None:
    """Return (level, sentence) for an event that the operator must know of, else None."""
    match event:
        case HostVented(reason) if reason == "operator":
            return "warning", "vented"
        case HostVented(reason) if reason in {"close", "quit"}:
            return None
        case HostVented(reason):
            return "error", f"vented: {reason}"
        case VentConfirmed():
            return None
        case InstrumentFault(code, text):
            return "error", f"instrument fault {code}: {text}; F8 clears it"
        case LinkLost(reason):
            return "error", f"{reason}; plug it in again, it is being looked for"
        case Alarm(text):
            return "error", text
        case _:
            return None
