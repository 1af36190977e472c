"""The services of OPC UA by which a subscription is made, asked for its messages, and ended."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import NamedTuple

from asyncua import ua

from abbe.drivers.link import LinkError, LinkProtocolError
from abbe.drivers.opcua.session import OpcuaSession, moment

_LIFETIME = 10.0
"""s without a Publish after which the server deletes a subscription, as it does the session."""
_MOST = 1000
"""Values in one message; what is more comes with the next."""


class Subscribed(NamedTuple):
    """A subscription as the server granted it.

    Attributes
    ----------
    number
        Its id in the server.
    every
        s between two messages.
    quiet
        s after which a message comes although there is nothing to say.
    sampling
        Handle → s between two samples, of what the server monitors.
    refused
        Handle → why the server does not monitor it.
    """

    number: int
    every: float
    quiet: float
    sampling: Mapping[int, float]
    refused: Mapping[int, str]


class Monitored(NamedTuple):
    """What is to be monitored.

    Attributes
    ----------
    node
        The variable.
    every
        s between two samples.
    stamped
        Whether to be told of a new source time stamp, too, where the value is the same.
    """

    node: ua.NodeId
    every: float
    stamped: bool


class Published(NamedTuple):
    """One message of a subscription.

    Attributes
    ----------
    subscription
        Id of the one that it is of.
    sequence
        Its number; of one without content that of the next one.
    published_at
        When it was first made, by the server's clock; None: it does not say.
    changes
        Handle and what is new, in order.
    ended
        Why the server ends the subscription; empty: it does not.
    more
        Whether the next one waits already.
    asked_at, arrived_at
        When the Publish that it answers left, and when it came, monotonic, s.
    made_at
        When the answer was made, by the server's clock; None: it does not say.
    """

    subscription: int
    sequence: int
    published_at: datetime | None
    changes: Sequence[tuple[int, ua.DataValue]]
    ended: str
    more: bool
    asked_at: float
    arrived_at: float
    made_at: datetime | None


async def subscribe(
    session: OpcuaSession, every: float, monitored: Sequence[Monitored]
) -> Subscribed:
    """Make a subscription; handles are the places in `monitored`.

    Each variable is sampled into a queue of one: the newest counts.

    Raises
    ------
    LinkError
        When there is none to be had.
    """
    request = ua.CreateSubscriptionRequest()
    request.Parameters.RequestedPublishingInterval = 1000.0 * every
    request.Parameters.RequestedMaxKeepAliveCount = 1
    request.Parameters.RequestedLifetimeCount = max(10, math.ceil(_LIFETIME / every))
    request.Parameters.MaxNotificationsPerPublish = _MOST
    response: ua.CreateSubscriptionResponse = await session.ask(
        request, ua.CreateSubscriptionResponse
    )
    made = response.Parameters
    granted = _positive(made.RevisedPublishingInterval) / 1000.0 or every
    items = ua.CreateMonitoredItemsRequest()
    items.Parameters.SubscriptionId = made.SubscriptionId
    items.Parameters.TimestampsToReturn = ua.TimestampsToReturn.Both
    items.Parameters.ItemsToCreate = [_item(i, each) for i, each in enumerate(monitored)]
    found: ua.CreateMonitoredItemsResponse = await session.ask(
        items, ua.CreateMonitoredItemsResponse
    )
    results = found.Results or []
    if len(results) != len(monitored):
        raise LinkProtocolError(f"{len(monitored)} variables to monitor, {len(results)} answered")
    return Subscribed(
        made.SubscriptionId,
        granted,
        granted * max(1, made.RevisedMaxKeepAliveCount),
        {
            # 0: as fast as there is something new; what was asked for is surely no slower
            i: _positive(result.RevisedSamplingInterval) / 1000.0 or monitored[i].every
            for i, result in enumerate(results)
            if result.StatusCode.is_good()
        },
        {i: r.StatusCode.name for i, r in enumerate(results) if not r.StatusCode.is_good()},
    )


async def publish(
    session: OpcuaSession, acknowledged: Sequence[tuple[int, int]], patience: float
) -> Published:
    """Ask for the next message.

    Parameters
    ----------
    session
        The session.
    acknowledged
        Subscription and number of messages that the server need not keep any longer.
    patience
        s that the server may take.

    Raises
    ------
    LinkError
        When none comes, or there is no subscription any more.
    """
    request = ua.PublishRequest()
    request.Parameters.SubscriptionAcknowledgements = [
        ua.SubscriptionAcknowledgement(*each) for each in acknowledged
    ]
    asked_at = time.monotonic()
    response: ua.PublishResponse = await session.ask(request, ua.PublishResponse, patience)
    arrived_at = time.monotonic()
    found = response.Parameters
    message = found.NotificationMessage
    changes: list[tuple[int, ua.DataValue]] = []
    ended = ""
    for data in message.NotificationData or []:
        if isinstance(data, ua.DataChangeNotification):
            changes += [(each.ClientHandle, each.Value) for each in data.MonitoredItems or []]
        elif isinstance(data, ua.StatusChangeNotification):
            ended = f"the server says of it: {data.Status.name}"
    return Published(
        found.SubscriptionId,
        message.SequenceNumber,
        moment(message.PublishTime),
        changes,
        ended,
        bool(found.MoreNotifications),
        asked_at,
        arrived_at,
        moment(response.ResponseHeader.Timestamp),
    )


async def unsubscribe(session: OpcuaSession, number: int) -> None:
    """End a subscription, as far as the server lets it."""
    request = ua.DeleteSubscriptionsRequest()
    request.Parameters.SubscriptionIds = [number]
    try:
        await session.ask(request, ua.DeleteSubscriptionsResponse)
    except LinkError:
        return


def _item(handle: int, monitored: Monitored) -> ua.MonitoredItemCreateRequest:
    item = ua.MonitoredItemCreateRequest()
    item.ItemToMonitor = ua.ReadValueId(NodeId=monitored.node, AttributeId=ua.AttributeIds.Value)
    item.MonitoringMode = ua.MonitoringMode.Reporting
    item.RequestedParameters.ClientHandle = handle
    item.RequestedParameters.SamplingInterval = 1000.0 * monitored.every
    item.RequestedParameters.QueueSize = 1
    item.RequestedParameters.DiscardOldest = True
    if monitored.stamped:
        item.RequestedParameters.Filter = ua.DataChangeFilter(
            Trigger=ua.DataChangeTrigger.StatusValueTimestamp
        )
    return item


def _positive(number: float) -> float:
    """A server's number where it can be a duration, else 0."""
    return number if math.isfinite(number) and number > 0.0 else 0.0
