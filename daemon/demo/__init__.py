"""``abbe demo``: a simulated machine is started, measured, modelled and corrected live."""
