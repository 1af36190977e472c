"""The catalogue of effects: one file a family; an effect's docstring is its page."""
