"""What makes parts of the repository out of other parts: the pages of the effects' handbook."""
