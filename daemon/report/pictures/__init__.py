"""Pictures of a page: what is packed into it, and what draws them, on a screen and on paper."""
