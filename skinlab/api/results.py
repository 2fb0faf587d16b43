"""What the functions of `import skinlab` return: fields as attributes, text, frames, pictures."""

from __future__ import annotations

import copy
import html
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from importlib import import_module
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skinlab.api.arguments import plain
from skinlab.curves import campaign as campaigns
from skinlab.curves import curve as curves
from skinlab.errors import InputError
from skinlab.text import counted, inert_lines, needs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from skinlab.discrepancy import outcome as outcomes
    from skinlab.inference import result as identifications
    from skinlab.inference.identify import Identifier
    from skinlab.mechanics.model_file import Model
    from skinlab.recording import session as sessions
    from skinlab.report.measured import Measured
    from skinlab.studies.make_study import Made
    from skinlab.tables.table import Table

_MANY = 40  # lines of a text, after which a notebook shows fewer


class Record(dict[str, Any]):
    """An object of a JSON document: `record["low"]` and `record.low` are the same."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"no field {name!r}; there are {', '.join(self)}") from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]


def _records(value: Any) -> Any:
    if isinstance(value, dict):
        return Record({key: _records(one) for key, one in value.items()})
    return [_records(one) for one in value] if isinstance(value, list) else value


def pandas() -> Any:
    """Return the module.

    Raises:
        InputError: it is not installed.
    """
    try:
        return import_module("pandas")
    except ImportError:
        raise InputError(needs("to_frame() needs", "pandas", "notebook")) from None


class Shown(ABC):
    """A result that prints as the command line does, and shows itself in a notebook."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain data, which `json.dumps` takes."""

    def to_frame(self) -> Any:
        """Return a pandas.DataFrame of what is a table in it.

        Raises:
            InputError: pandas is not installed.
        """
        return pandas().DataFrame(self._columns())

    @abstractmethod
    def _columns(self) -> Mapping[str, Sequence[Any]]: ...

    @abstractmethod
    def _text(self) -> str: ...

    @abstractmethod
    def _brief(self) -> str: ...

    def _figure(self) -> Figure | None:
        """Return the picture; called inside `pictures.style()`."""
        return None

    def __str__(self) -> str:
        return inert_lines(self._text())

    def __repr__(self) -> str:
        return inert_lines(f"<skinlab.{type(self).__name__}: {self._brief()}>")

    def _repr_html_(self) -> str:
        lines = str(self).splitlines()
        if len(lines) > _MANY:
            lines = [*lines[: _MANY - 1], f"… {len(lines) - _MANY + 1} more lines"]
        text = html.escape("\n".join(lines))
        return f'<div class="skinlab">{self._image()}<pre>{text}</pre></div>'

    def _image(self) -> str:
        from skinlab.report.pictures import style, to_data_uri

        try:
            with style():
                figure = self._figure()
                if figure is None:
                    return ""
                source = to_data_uri(figure)
        except InputError as error:  # no picture is no reason to show nothing
            return f"<p>{html.escape(inert_lines(str(error)))}</p>"
        return f'<img src="{source}" alt="{html.escape(repr(self))}" style="max-width: 100%">'


class Document(Shown):
    """A result that is a JSON document of the command line; its fields are attributes."""

    def __init__(self, document: dict[str, Any], *parts: str | int) -> None:
        """`parts` lead to the entry whose fields are attributes, before those of the document."""
        self._document: Record = _records(document)
        self._entry: Record = self._document
        for part in parts:
            self._entry = self._entry[part]  # type: ignore[index] # a field's or a list's

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_"):
            for place in (self._entry, self._document):
                if name in place:
                    return place[name]
        raise AttributeError(f"{type(self).__name__} has no field {name!r}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._entry, *self._document]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document, as `--json` prints it."""
        plain: dict[str, Any] = _plain(self._document)
        return plain


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list) else copy.copy(value)


def _interval_rows(parameters: Mapping[str, Any] | None, **first: Any) -> Iterable[dict[str, Any]]:
    for name, value in (parameters or {}).items():
        yield {**first, "parameter": name, **value}


def _by_column(rows: Iterable[Mapping[str, Any]], names: Sequence[str]) -> dict[str, list[Any]]:
    found = list(rows)
    return {name: [row[name] for row in found] for name in names}


class Curve(Shown, curves.Curve):
    """A measured or simulated curve: `setup`, and `time_s`, `pressure_mbar`, `deflection_mm` (n,).

    `phase` (n,) is what the skin sees: load, hold, unload or rest.
    """

    @classmethod
    def of(cls, curve: curves.Curve) -> Curve:
        """Return the same curve as one of these."""
        return cls(**{f.name: getattr(curve, f.name) for f in fields(curve) if f.init})

    def to_dict(self) -> dict[str, Any]:
        """Return name, setup and columns as plain data."""
        return {
            "name": self.name,
            "setup": _setup(self.setup),
            "partial": self.partial,
            **{name: column.tolist() for name, column in self._columns().items()},
        }

    def _columns(self) -> dict[str, Any]:
        names = ("time_s", "pressure_mbar", "deflection_mm", "phase")
        return {name: getattr(self, name) for name in names}

    def _text(self) -> str:
        import io

        from skinlab.curves.csv import write_curve

        text = io.StringIO()
        write_curve(text, self)
        return text.getvalue().rstrip("\n")

    def _brief(self) -> str:
        setup = self.setup
        partial = ", partial" if self.partial else ""
        return (
            f"{self.name}, {len(self)} samples, {setup.aperture_mm:g} mm opening, "
            f"{setup.thickness_mm:g} mm skin{partial}"
        )

    def _figure(self) -> Figure:
        from skinlab.report.plots import draw_fit

        return draw_fit(_measured(1, self))


def _setup(setup: curves.Setup) -> dict[str, Any]:
    program = None if setup.program is None else str(setup.program)
    return {**asdict(setup), "program": program}


def _measured(number: int, curve: curves.Curve) -> Measured:
    from skinlab.report.measured import Judged, Measured

    return Measured(number, curve, Judged(), None, "Nothing was identified from this curve.")


def _figure_of_all(found: Sequence[curves.Curve]) -> Figure | None:
    from skinlab.report.plots import draw_all_curves

    return draw_all_curves([_measured(i, c) for i, c in enumerate(found, 1)]) if found else None


@dataclass(frozen=True, eq=False, repr=False)
class Campaign(Shown, campaigns.Campaign):
    """Curves that are explained together: `title`, `curves`, and the noise that is stated.

    Raises:
        InputError: there is no curve, or a number is none that can be stated.
    """

    def __post_init__(self) -> None:
        """Refuse what a campaign.toml could not say."""
        given: Any = self.curves
        if not isinstance(given, list | tuple) or not given:
            raise InputError("curves: expected one curve or more, such as read_curve returns")
        for one in given:
            if not isinstance(one, curves.Curve):
                raise InputError(f"curves: {one!r} is no curve, such as read_curve returns")
        title: Any = self.title
        if not isinstance(title, str):
            raise InputError(f"title {title!r}: expected a text")
        object.__setattr__(self, "curves", tuple(given))
        scatter: Any = self.placement_scatter
        if scatter == "auto":  # as a campaign.toml may say
            object.__setattr__(self, "placement_scatter", None)
        for name in ("noise_um", "pressure_noise_mbar", "placement_scatter"):
            value: Any = plain(getattr(self, name))
            object.__setattr__(self, name, value)
            number = isinstance(value, Real) and not isinstance(value, bool)
            words = campaigns.range_missed(name, value if value is None or number else math.nan)
            if words is not None:
                raise InputError(f"{name} {value!r}: expected {words}, or None")

    def to_dict(self) -> dict[str, Any]:
        """Return what is stated, and the curves, as plain data."""
        return {
            "title": self.title,
            "noise_um": self.noise_um,
            "pressure_noise_mbar": self.pressure_noise_mbar,
            "placement_scatter": self.placement_scatter,
            "curves": [Curve.of(c).to_dict() for c in self.curves],
        }

    def _columns(self) -> dict[str, list[Any]]:
        return _curve_columns(self.curves)

    def _text(self) -> str:
        lines = [self.title or "campaign"]
        lines += [f"  {Curve.of(c)._brief()}, cycle {c.setup.cycle}" for c in self.curves]
        return "\n".join(lines)

    def _brief(self) -> str:
        return f"{self.title or 'no title'}, {counted(len(self.curves), 'curve')}"

    def _figure(self) -> Figure | None:
        return _figure_of_all(self.curves)


def _curve_columns(found: Sequence[curves.Curve]) -> dict[str, list[Any]]:
    """Return the samples of several curves, one below the other."""
    columns: dict[str, list[Any]] = {"curve": [c.name for c in found for _ in range(len(c))]}
    for name in ("time_s", "pressure_mbar", "deflection_mm", "phase"):
        columns[name] = [v for c in found for v in getattr(c, name).tolist()]
    return columns


class Session(Document):
    """A session file: `path`, `meta`, `curves` and `results` (None where nothing was identified).

    What was stated when it was recorded (`subject`, `site`, …) are attributes too.
    """

    def __init__(self, path: Path, session: sessions.Session) -> None:
        self._session = session
        self.path = path
        self.curves = tuple(Curve.of(c) for c in session.curves)
        super().__init__(
            {
                "file": str(path),
                "meta": session.meta,
                "results": list(session.results),
            },
            "meta",
        )

    @property
    def measured_utc(self) -> str:
        """When it was measured: UTC, or a day alone; "" of an imported one if nobody stated it."""
        from skinlab.recording.session import measured_utc

        return measured_utc(self._session.meta)

    @property
    def left_out(self) -> dict[str, str]:
        """Why curves do not count together: left out by the operator, or cut short."""
        from skinlab.recording.session_fit import left_out_of

        return left_out_of(self._session)

    def to_dict(self) -> dict[str, Any]:
        """Return file, meta, curves and results as plain data."""
        return {**super().to_dict(), "curves": [c.to_dict() for c in self.curves]}

    def _columns(self) -> dict[str, list[Any]]:
        return _curve_columns(self.curves)

    def _text(self) -> str:
        from skinlab.report.session_text import describe_session

        return describe_session(self.path, self._session)

    def _brief(self) -> str:
        return f"{self.path}, {counted(len(self.curves), 'curve')}"

    def _figure(self) -> Figure | None:
        return _figure_of_all(self.curves)


class Identification(Document):
    """What was identified from one curve, or from several together: an entry of the document.

    `parameters`, `flags`, `error_um`, … are those of the entry; `model`, `database`, `method`,
    `seed` those of the document `skinlab.identification/1`.
    """

    def __init__(
        self,
        found: identifications.Identification,
        given: Sequence[curves.Curve],
        identifier: Identifier,
    ) -> None:
        from skinlab.inference.result import document

        # Without the draws: megabytes that no field shows, of each of many results.
        self._found = replace(found, uncertainty=None)
        self._curves, self._identifier = tuple(given), identifier
        provenance = identifier.provenance()
        if found.files is None:
            super().__init__(document(provenance, [found]), "curves", 0)
        else:
            super().__init__(document(provenance, [], joint=found), "joint")

    @property
    def model_mm(self) -> Any:
        """The fitted curve (points,), NaN where there is none; None of several curves together."""
        return self._found.model_mm

    def _columns(self) -> dict[str, list[Any]]:
        rows = _interval_rows(self._entry["parameters"])
        return _by_column(rows, ("parameter", "value", "low", "high"))

    def _text(self) -> str:
        from skinlab.report.text import describe

        return describe(self._found)

    def _brief(self) -> str:
        values = self._entry["parameters"] or {}
        said = [f"{name} {value['value']:.4g}" for name, value in values.items()]
        return ", ".join(said + list(self._found.flags)) or str(self._found.error)

    def _figure(self) -> Figure | None:
        from skinlab.inference.stored_results import stored_result
        from skinlab.report.fitted import fit_again
        from skinlab.report.measured import Judged, Measured
        from skinlab.report.plots import draw_fit

        if self._found.files is not None:
            return _figure_of_all(self._curves)
        (curve,) = self._curves
        stored = stored_result(1, self._found.to_json())
        fit = "" if stored is None or stored.error else fit_again(curve, stored, self._identifier)
        return draw_fit(Measured(1, curve, Judged(), stored, fit))


class Measurement(Document):
    """What was measured: the document of `skinlab measure --json`, `results` and `recorded`.

    `session` is the path of the session file, `dose` what the site has had, `results` an
    Identification for each curve, `recorded` the curves.
    """

    def __init__(
        self,
        document: dict[str, Any],
        results: Sequence[Identification],
        recorded: Sequence[Curve],
        dose_text: str,
    ) -> None:
        self.results, self.recorded, self._dose_text = tuple(results), tuple(recorded), dose_text
        super().__init__(document)

    def _columns(self) -> dict[str, list[Any]]:
        rows = [
            row
            for number, one in enumerate(self.results, start=1)
            for row in _interval_rows(one.parameters, curve=number)
        ]
        return _by_column(rows, ("curve", "parameter", "value", "low", "high"))

    def _text(self) -> str:
        texts = [str(one) for one in self.results]
        return "\n".join([*texts, self._dose_text, f"session: {self.session}"])

    def _brief(self) -> str:
        return f"{self.session}, {counted(len(self.results), 'curve')}"

    def _figure(self) -> Figure | None:
        return _figure_of_all(self.recorded)


class Explanation(Document):
    """What the model misses: the document `skinlab.discrepancy/1`."""

    def __init__(
        self,
        outcome: outcomes.Outcome,
        base: Model,
        table: Table,
        data: Mapping[str, str],
    ) -> None:
        self._outcome, self._base, self._table, self._data = outcome, base, table, dict(data)
        super().__init__(outcome.to_json())

    def adopt(self, path: Any) -> Path:
        """Write the model with the missing effect to a new MODEL.toml; return its path.

        Raises:
            InputError: the verdict names no effect, or the file exists or cannot be written.
        """
        from skinlab.api.explaining import adopt
        from skinlab.api.paths import as_path

        to = as_path(path)
        adopt(self._outcome, to, self._base, self._table, self._data)
        self._document["adopted_model"] = str(to)
        return to

    def write_report(self, folder: Any) -> Path:
        """Write the HTML report into a folder; return its path.

        Raises:
            InputError: it cannot be written.
        """
        from skinlab.api.paths import as_path
        from skinlab.report.missing_effect import write_report

        return write_report(self._outcome, as_path(folder))

    def _columns(self) -> dict[str, list[Any]]:
        stages = ("before", "after")
        rows = [r for s in stages for r in _interval_rows(self.parameters[s], stage=s)]
        for candidate in self.candidates[: len(self.effects)]:
            rows += _interval_rows(candidate["parameters"], stage=" and ".join(candidate.effects))
        return _by_column(rows, ("stage", "parameter", "value", "low", "high"))

    def _text(self) -> str:
        from skinlab.discrepancy.text import describe

        return describe(self._outcome)

    def _brief(self) -> str:
        named = " or ".join(" and ".join(effects) for effects in self.effects)
        return f"{self.verdict}{': ' if named else ''}{named}"

    def _figure(self) -> Figure:
        from skinlab.report.missing_effect import draw_residuals

        return draw_residuals(self._outcome)


class Study(Document):
    """What many curves say: the document `skinlab.study/1`; `folder` has the tables and pages.

    Its frame is curves.csv, a row a curve.
    """

    def __init__(self, made: Made, folder: Path) -> None:
        super().__init__(made.document)
        self._made, self.folder = made, folder

    def _columns(self) -> Mapping[str, Sequence[Any]]:
        from skinlab.studies.table import TEXT

        kept = dict.fromkeys(TEXT - {"visit"}, str)  # a subject 007 is not 7, and NA is a text
        return pandas().read_csv(  # type: ignore[no-any-return]
            self.folder / "curves.csv", dtype=kept, keep_default_na=False, na_values=[""]
        )

    def _text(self) -> str:
        return "\n".join(self._made.lines)

    def _brief(self) -> str:
        return f"{self.folder}, {counted(self.curves, 'curve')}"

    def _figure(self) -> Figure | None:
        from skinlab.studies.plots import draw_shares
        from skinlab.studies.reliability import reliability
        from skinlab.studies.report import main_analyses
        from skinlab.studies.table import read_columns

        main = main_analyses(reliability(read_columns(self.folder / "curves.csv")))
        return draw_shares(main) if main else None


OnResult = Callable[[Identification], None]
