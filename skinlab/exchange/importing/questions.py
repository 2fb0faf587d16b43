"""What a file leaves open: answered by an option, from before, at a terminal, or refused."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from skinlab.errors import InputError
from skinlab.exchange.importing.remembered import Remembered


@dataclass(frozen=True)
class Question:
    """One thing that a file does not say."""

    option: str  # the option that answers it, without `--`
    text: str  # a sentence that says what is open
    choices: tuple[str, ...]  # what can be answered


class OpenError(InputError):
    """What a file leaves open, and nobody answered."""


Ask = Callable[[Question], str]


class Answers:
    """Answers that options gave, and those that somebody gives when asked.

    The same question is asked once, however many files leave it open.
    """

    def __init__(
        self,
        stated: Mapping[str, str] | None = None,
        ask: Ask | None = None,
        remembered: Remembered | None = None,
        command: str = "",
    ) -> None:
        """`stated` by option; without `ask` an open question is an InputError.

        `remembered` are answers from before, by the headings of a file. `command` is the one that
        takes the options, where that is another than the one that reads.
        """
        self._stated = dict(stated or {})
        self._ask = ask
        self._remembered = remembered
        self._command = command
        self._headings: tuple[str, ...] = ()
        self._given: dict[tuple[tuple[str, ...], Question], str] = {}
        self.recalled: list[str] = []  # what was answered from before, of the present file

    def begin(self, headings: Sequence[str] = ()) -> None:
        """Begin a file, or go on with its headings, once they are known."""
        self._headings, self.recalled = tuple(headings), []

    def stated(self, option: str) -> str | None:
        """Return what the option says, or None."""
        return self._stated.get(option)

    def choose(self, question: Question) -> str:
        """Return the answer.

        Raises:
            OpenError: nobody can be asked.
        """
        key = (self._headings, question)
        if key in self._given:
            return self._given[key]
        before = self._from_before(question)
        if before is not None:
            self.recalled.append(f"--{question.option} {before}, as answered before")
            return before
        if self._ask is None:
            choices = " or ".join(shlex.quote(choice) for choice in question.choices)
            say = f"answer it with `{self._command}`, by" if self._command else "say with"
            raise OpenError(f"{question.text}; {say} --{question.option} {choices}")
        answer = self._ask(question)
        self._given[key] = answer
        if self._remembered is not None:
            self._remembered.keep(self._headings, question.option, answer)
        return answer

    def unasked(self) -> Answers:
        """Return the same without anybody who can be asked."""
        return Answers(self._stated, remembered=self._remembered)

    def _from_before(self, question: Question) -> str | None:
        if self._remembered is None:
            return None
        answer = self._remembered.answer(self._headings, question.option)
        return answer if answer in question.choices else None
