"""What ``abbe fleet diagnose`` answers: every campaign of many machines, diagnosed anew."""
