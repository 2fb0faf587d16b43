"""Whose skin was measured, and where, as far as it is stated."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StatedSkin:
    """What a file states of the skin that was measured; empty where nobody stated it."""

    file: str
    subject: str = ""
    site: str = ""


def two_people(one: StatedSkin, other: StatedSkin) -> str:
    """Return in words whose skins these are; empty: nobody stated that they are two people's."""
    if not differ(one.subject, other.subject):
        return ""
    return f"{one.file} is of {one.subject} and {other.file} of {other.subject}"


def differ(one: str, other: str) -> bool:
    """Return whether both are stated and differ."""
    return bool(one and other) and one.casefold() != other.casefold()
