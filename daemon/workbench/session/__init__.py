"""A session of the workbench: a model, its campaigns, its versions, and what is known of them."""
