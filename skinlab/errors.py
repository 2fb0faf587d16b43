"""Errors that a user can cause or must know of. Each carries one sentence and an exit status.

The statuses are those of the command line: 3 bad input data, 4 probe or link failed, 5 the result
is not trustworthy.
"""


class SkinlabError(Exception):
    """Root of the errors that are told in one sentence; anything else is a bug."""

    exit_status = 3


class InputError(SkinlabError, ValueError):
    """Bad input data: names the file, the line or field, and what was expected."""


class BrokenPluginError(SkinlabError):
    """An installed extension broke down at work: names it, and its own error."""


class AcquisitionError(SkinlabError):
    """The probe or its link failed; says what is known of the vent; what was measured is saved."""

    exit_status = 4


class NotTrustworthyError(SkinlabError):
    """A number exists that should not be used (not converged, outside the database)."""

    exit_status = 5
