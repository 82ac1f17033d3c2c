from urllib.error import HTTPError, URLError
from urllib.request import urlopen

import pytest

from lacoloco.pipelines.viewing.server import served


def test_the_page_is_there_as_long_as_it_is_served():
    with served(b"<p>hello</p>") as address:
        assert address.startswith("http://127.0.0.1:")
        with urlopen(f"{address}?x=1") as answer:
            assert answer.read() == b"<p>hello</p>"
        with pytest.raises(HTTPError, match="404"):
            urlopen(f"{address}secret")
    with pytest.raises(URLError):
        urlopen(address, timeout=1)
