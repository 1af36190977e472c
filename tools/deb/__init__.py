"""The Debian package: Abbe with an environment of its own, installed without a network."""
