"""What an operator without a screen must hear at once, in a sentence."""

from __future__ import annotations

from drivers.events import Alarm, Event, LinkLost, LinkRestored


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
