"""Text files that anybody may have written: bounded, with places of errors; written whole."""
