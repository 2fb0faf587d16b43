"""The same page as a PDF on A4, by weasyprint: nothing is fetched, as in the page itself."""

from __future__ import annotations

from skinlab.errors import InputError
from skinlab.text import needs


def check_pdf() -> None:
    """Say so before the page is made that could not become one.

    Raises:
        InputError: weasyprint is not installed, or not the library Pango, which it needs.
    """
    try:
        import weasyprint  # noqa: F401
    except ImportError:
        missing = needs("a PDF needs", "weasyprint", "pdf")
        raise InputError(f"{missing}; or print the HTML report") from None
    except OSError as error:
        raise InputError(
            f"a PDF needs the library Pango ({error}); or print the HTML report"
        ) from None


def to_pdf(html: str) -> bytes:
    """Return the PDF of a page that stands alone."""
    from weasyprint import HTML
    from weasyprint.urls import URLFetcher

    # The pictures inside the page, and nothing from elsewhere
    return bytes(HTML(string=html, url_fetcher=URLFetcher(allowed_protocols=["data"])).write_pdf())
