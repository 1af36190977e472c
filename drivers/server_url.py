"""Addresses of servers that a configuration gives as a URL: HOST and PORT under one scheme."""

from __future__ import annotations

from urllib.parse import SplitResult, urlsplit


def server_url(url: str, scheme: str, shape: str) -> SplitResult:
    """The parts of a server's address.

    Parameters
    ----------
    url
        As it is configured.
    scheme
        The only one that the link speaks.
    shape
        What is expected, for people.

    Raises
    ------
    ValueError
        For another scheme, no host, or a port that is none.
    """
    parts = urlsplit(url)
    if parts.scheme != scheme or not parts.hostname:
        raise ValueError(f"expected {shape}, found {url!r}")
    try:
        _ = parts.port
    except ValueError as error:
        raise ValueError(f"{error}: {url!r}") from None
    return parts
