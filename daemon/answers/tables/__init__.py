"""The answer of ``abbe table``: tables that are made for a controller, and what is said of them."""
