"""What ``abbe uncertainty`` answers: the virtual CMM, its draws spread, its figures in words."""
