"""What a file leaves open: answered by an option, by somebody at a terminal, or refused."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from skinlab.errors import InputError


@dataclass(frozen=True)
class Question:
    """One thing that a file does not say."""

    option: str  # the option that answers it, without `--`
    text: str  # a sentence that says what is open
    choices: tuple[str, ...]  # what can be answered


Ask = Callable[[Question], str]


class Answers:
    """Answers that options gave, and those that somebody gives when asked.

    The same question is asked once, however many files leave it open.
    """

    def __init__(self, stated: Mapping[str, str] | None = None, ask: Ask | None = None) -> None:
        """`stated` by option; without `ask` an open question is an InputError."""
        self._stated = dict(stated or {})
        self._ask = ask
        self._given: dict[Question, str] = {}

    def stated(self, option: str) -> str | None:
        """Return what the option says, or None."""
        return self._stated.get(option)

    def choose(self, question: Question) -> str:
        """Return the answer.

        Raises:
            InputError: nobody can be asked.
        """
        if question in self._given:
            return self._given[question]
        if self._ask is None:
            choices = " or ".join(shlex.quote(choice) for choice in question.choices)
            raise InputError(f"{question.text}; say with --{question.option} {choices}")
        answer = self._ask(question)
        self._given[question] = answer
        return answer
