"""Colours: dark, light, high contrast, and safe for the colour-blind."""

from __future__ import annotations

from textual.theme import Theme

HIGH_CONTRAST = Theme(
    name="skinlab-contrast",
    primary="#ffffff",
    secondary="#ffff00",
    warning="#ffff00",
    error="#ff6060",
    success="#00ff00",
    accent="#00ffff",
    foreground="#ffffff",
    background="#000000",
    surface="#000000",
    panel="#202020",
    dark=True,
    text_alpha=1.0,
    variables={"input-selection-background": "#0040a0"},  # else white stands on light grey
)
# Okabe and Ito's colours: told apart with every kind of colour blindness
COLOUR_BLIND_SAFE = Theme(
    name="skinlab-okabe-ito",
    primary="#0072B2",
    secondary="#56B4E9",
    warning="#E69F00",
    error="#D55E00",
    success="#56B4E9",
    accent="#F0E442",
    foreground="#f0f0f0",
    background="#101010",
    surface="#181818",
    panel="#282828",
    dark=True,
)
OWN = (HIGH_CONTRAST, COLOUR_BLIND_SAFE)
ORDER = ("textual-dark", "textual-light", HIGH_CONTRAST.name, COLOUR_BLIND_SAFE.name)
WORDS = {
    "textual-dark": "dark",
    "textual-light": "light",
    HIGH_CONTRAST.name: "high contrast",
    COLOUR_BLIND_SAFE.name: "colour-blind safe",
}


def next_theme(name: str) -> str:
    """Return the theme after this one; after the last comes the first."""
    at = ORDER.index(name) if name in ORDER else -1
    return ORDER[(at + 1) % len(ORDER)]
