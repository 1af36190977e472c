"""Why a subscription cannot be followed any longer."""

from __future__ import annotations

from abbe.drivers.link import LinkError


class SubscriptionLostError(LinkError):
    """What a server notifies of cannot be used any longer, until the subscription is made anew."""
