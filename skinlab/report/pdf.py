"""The same page as a PDF on A4, by weasyprint: nothing is fetched, as in the page itself."""

from __future__ import annotations

from skinlab.errors import InputError

_MISSING = "a PDF needs weasyprint: pip install 'skinlab[pdf]', or print the HTML report"


def check_pdf() -> None:
    """Say so before the page is made that could not become one.

    Raises:
        InputError: weasyprint is not installed, or not the library Pango, which it needs.
    """
    try:
        import weasyprint  # noqa: F401
    except (ImportError, OSError) as error:
        raise InputError(f"{_MISSING} ({error})") from None


def to_pdf(html: str) -> bytes:
    """Return the PDF of a page that stands alone."""
    from weasyprint import HTML
    from weasyprint.urls import URLFetcher

    # The pictures inside the page, and nothing from elsewhere
    return bytes(HTML(string=html, url_fetcher=URLFetcher(allowed_protocols=["data"])).write_pdf())
