"""Many simulated machines at once: their runs, what these take, delays of what they say."""
