from __future__ import annotations

import pytest

from drivers.reconnect import Backoff


@pytest.mark.parametrize(
    "numbers", [(0, 2, 1, 10), (2, 2, 1, 10), (0.1, 0.5, 1, 10), (0.1, 2, 20, 10)]
)
def test_what_is_no_backoff(numbers):
    with pytest.raises(ValueError, match="sensible"):
        Backoff(*numbers)
