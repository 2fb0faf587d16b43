"""The report of a session: one HTML page, or its pictures as files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import cached_property
from typing import Literal

from skinlab.inference.identify import Identifier
from skinlab.recording.session import Session, measured_utc
from skinlab.report.curve_section import curve_section, overview_table
from skinlab.report.drawings import (
    Drawing,
    curve_drawings,
    posterior_drawings,
    session_drawings,
)
from skinlab.report.measured import Measured, measured_curves
from skinlab.report.methods import assumptions, how
from skinlab.report.page import Illustration, Section, page
from skinlab.report.page_one import Together, any_stored, fit_together, has_values, page_one
from skinlab.report.pictures import style, to_bytes, to_data_uri
from skinlab.report.protocol import protocol_section
from skinlab.report.provenance import provenance_section

Format = Literal["html", "pdf", "png", "svg"]
FORMATS: tuple[Format, ...] = ("html", "pdf", "png", "svg")

PAGE = "report.html"
PAGES = {"html": PAGE, "pdf": "report.pdf"}


@dataclass(frozen=True)
class SessionReport:
    """What can be written about a session.

    `identifier` is the one that it was identified with, or a sentence why that is unknown;
    `remarks` are sentences that a reader may not overlook, `more` are sections of others' making,
    `file` is the session's own name, without folders.

    Raises:
        InputError: a stored result is damaged; once something is asked for.
    """

    session: Session
    identifier: Identifier | str
    remarks: Sequence[str] = ()
    more: Sequence[Section] = ()
    file: str | None = None

    @cached_property
    def curves(self) -> tuple[Measured, ...]:
        """The curves, with all that is said of them."""
        return measured_curves(self.session, self.identifier)

    @cached_property
    def together(self) -> Together:
        """What the comparable curves say together."""
        return fit_together(self.session, self.identifier)

    @cached_property
    def drawings(self) -> list[Drawing]:
        """All pictures, in the order in which they stand on the page."""
        return [
            *session_drawings(self.curves),
            *posterior_drawings(self.together.answer),
            *(d for m in self.curves for d in curve_drawings(m)),
        ]

    def names(self, kind: Format) -> list[str]:
        """Return the names of the files, before anything is drawn."""
        if kind in PAGES:
            return [PAGES[kind]]
        return [f"{drawing.name}.{kind}" for drawing in self.drawings]

    def files(self, kind: Format, drawn: Callable[[], None] = lambda: None) -> dict[str, bytes]:
        """Return the files by name; `drawn` is called after each picture.

        Raises:
            InputError: matplotlib is not installed, or weasyprint, which a PDF needs.
        """
        if kind == "html":
            return {PAGE: self.html(drawn).encode("utf-8")}
        if kind == "pdf":
            from skinlab.report.pdf import check_pdf, to_pdf

            check_pdf()
            return {PAGES["pdf"]: to_pdf(self.html(drawn))}
        found = {}
        with style():
            for drawing in self.drawings:
                found[f"{drawing.name}.{kind}"] = to_bytes(drawing.draw(), kind)
                drawn()
        return found

    def html(self, drawn: Callable[[], None] = lambda: None) -> str:
        """Return the page, which stands alone; `drawn` is called after each picture.

        Raises:
            InputError: matplotlib is not installed.
        """

        def illustrate(drawings: Sequence[Drawing]) -> Iterator[Illustration]:
            for drawing in drawings:
                yield Illustration(to_data_uri(drawing.draw()), drawing.alt, drawing.caption)
                drawn()

        with style():
            overview = tuple(illustrate(session_drawings(self.curves)))
            posterior = tuple(illustrate(posterior_drawings(self.together.answer)))
            each = [tuple(illustrate(curve_drawings(m))) for m in self.curves]
        meta = self.session.meta
        about = [f"Subject {meta['subject']}"] if meta.get("subject") else []
        if meta.get("site"):
            about.append(str(meta["site"]))
        if measured := measured_utc(meta):
            about.append(_day_and_minute(measured))
        elif meta.get("created_utc"):
            imported = _day_and_minute(str(meta["created_utc"]))
            about.append(f"imported {imported}; nobody stated when it was measured")
        return page(
            "Skin measurement report",
            [
                page_one(
                    self.session,
                    self.curves,
                    self.together,
                    overview or (each[0][:1] if each else ()),
                    self.more,
                ),
                *protocol_section(self.session, self.curves),
                self._overview(posterior),
                *(curve_section(m, f) for m, f in zip(self.curves, each, strict=True)),
                *self._methods(),
                provenance_section(self.session, self.identifier, self.file),
            ],
            subtitle=" · ".join(about),
            notices=[*self._notices(), *self.remarks],
        )

    def _notices(self) -> list[str]:
        instrument = self.session.meta.get("instrument")
        if isinstance(instrument, dict) and instrument.get("simulated"):
            return ["SIMULATED: no skin was measured; the numbers come from a model of a probe."]
        control = self.session.meta.get("control")
        return [f"Measured read-only: {control}."] if isinstance(control, str) and control else []

    def _overview(self, figures: tuple[Illustration, ...]) -> Section:
        if not self.curves:
            return Section("Curve by curve", ("The session holds no curves.",))
        done = sum(m.result is not None and bool(m.result.parameters) for m in self.curves)
        count = f"{len(self.curves)} curves, of which {done} with values"
        if len(self.curves) == 1:
            count = f"One curve, {'with' if done else 'without'} values"
        if not any_stored(self.curves):
            count += " that the session stores"
        return Section(
            "Curve by curve",
            (
                f"{count}. Brackets hold 90 % intervals. Read the flags before a number is used: "
                "each curve's section says what they mean.",
            ),
            (overview_table(self.curves),),
            figures,
        )

    def _methods(self) -> list[Section]:
        if isinstance(self.identifier, str):
            return [Section("How the numbers were found", (f"Not known: {self.identifier}.",))]
        phases = next((m.result.phases for m in self.curves if m.result), None)
        answer = self.together.answer
        found = None if isinstance(answer, str) or not has_values(answer) else answer
        if phases is None and found is None:
            return [Section("How the numbers were found", ("Nothing was identified.",))]
        said = how(
            self.identifier,
            phases or self.identifier.phases,
            found,
            each=any_stored(self.curves),
        )
        return [
            Section("How the numbers were found", said),
            Section("What was assumed", points=assumptions(self.identifier, found)),
        ]


def _day_and_minute(utc: str) -> str:
    try:
        at = datetime.fromisoformat(utc)
    except ValueError:
        return utc
    return f"{at:%Y-%m-%d %H:%M} UTC" if at.utcoffset() == timedelta(0) else utc
