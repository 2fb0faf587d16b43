"""The same page as a PDF on A4, by weasyprint: nothing is fetched, as in the page itself."""

from __future__ import annotations

from typing import Any

from skinlab.errors import InputError

_MISSING = "a PDF needs weasyprint: pip install 'skinlab[pdf]', or print the HTML report"


def to_pdf(html: str) -> bytes:
    """Return the PDF of a page that stands alone.

    Raises:
        InputError: weasyprint is not installed, or not the library Pango, which it needs.
    """
    try:
        from weasyprint import HTML
    except (ImportError, OSError) as error:
        raise InputError(f"{_MISSING} ({error})") from None
    return bytes(HTML(string=html, url_fetcher=_only_data).write_pdf())


def _only_data(url: str, *arguments: Any, **options: Any) -> Any:
    """Read the pictures inside the page, and nothing elsewhere."""
    from weasyprint import default_url_fetcher

    if not url.startswith("data:"):
        raise ValueError(f"{url}: a report fetches nothing")
    return default_url_fetcher(url, *arguments, **options)
