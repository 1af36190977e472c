"""What is hidden: causes from physics, for the exact chain, with no view of the effects' code."""
