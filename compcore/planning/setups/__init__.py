"""Set-ups that a person can do: lines, points in the volume, rotary axes; usual programmes."""
