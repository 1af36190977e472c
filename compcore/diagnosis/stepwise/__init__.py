"""Step by step from a machine and a campaign to a model."""

from abbe.compcore.diagnosis.stepwise.step import Course, Step
from abbe.compcore.diagnosis.stepwise.to_the_verdict import to_the_verdict
from abbe.compcore.diagnosis.stepwise.unseen import UnseenCampaign

__all__ = ["Course", "Step", "UnseenCampaign", "to_the_verdict"]
