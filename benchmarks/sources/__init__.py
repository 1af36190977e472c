"""The experiments of Abbe's sources, simulated with exact rigid bodies and evaluated by Abbe."""
