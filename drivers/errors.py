"""The error tree of the driver. An error's type says who is to blame."""


class DriverError(Exception):
    """Root of everything that the driver raises."""


class LinkError(DriverError, OSError):
    """The link: no such port, unplugged, refused, timed out."""


class PortUrlError(LinkError, ValueError):
    """The URL itself is wrong: nothing was opened, and no other port would make it right."""


class PortFileError(LinkError, ValueError):
    """A file that the URL names (a simulated probe's skin or faults) is wrong."""


class ProtocolError(DriverError):
    """Root of what goes wrong in the conversation itself."""


class LocalProtocolError(ProtocolError):
    """We asked for what is not allowed in this state or beyond a limit; nothing was sent."""


class LimitError(LocalProtocolError):
    """What is to be loaded makes no sense, or is beyond a limit: another program would be taken."""


class RemoteProtocolError(ProtocolError):
    """The instrument said what the protocol does not allow."""


class BrokenDialectError(ProtocolError):
    """The code of a dialect broke down: names it, the package that it is from, and its error."""


class InstrumentRefusedError(DriverError):
    """The instrument understood and said no; the message carries its reason."""


class UnknownDialectError(DriverError, ValueError):
    """No dialect has this name."""


class DialectFileError(DriverError, ValueError):
    """A file that should describe a dialect does not: one sentence that names file and field."""
