"""What the store is asked: machines and how they are, their models and campaigns."""
