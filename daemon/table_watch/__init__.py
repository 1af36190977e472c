"""``abbe watch-tables``: tables made anew when the machine has warmed, upload proposed when idle.

The daemon's configuration says where positions and signals are read; nothing is ever written to the
machine. The tables that were made last hold for the signals of that moment; when the model predicts
that the error has changed by more than a stated amount anywhere in the working volume, they are
made anew.
"""
