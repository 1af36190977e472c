"""The answers of ``abbe fleet``."""
