"""What the analysing commands share: loading, progress, and their answers as JSON and as text."""
