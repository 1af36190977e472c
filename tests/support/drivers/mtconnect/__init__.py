"""An MTConnect agent after the published schemas, that can also be told to be hostile."""
