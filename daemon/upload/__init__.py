"""Compensation tables safely into a controller: checked, backed up, staged, read back, activated.

================ =====================================================================
``content``      a set of files and its one SHA-256
``order``        what is to be uploaded, read and matched with the configuration
``bounds``       how large tables are, and how far from the present ones
``preflight``    the questions to the controller before anything is written
``journal``      the record of every step, append-only, each line sealed by the next
``lock``         one upload at a time
``backups``      what was active before, kept for good
``steps``        the sequence, and what happens where it breaks
``settle``       finding out what is active after a failure, and putting it right
``effect``       whether the controller adds what the table says
``recovery``     an upload that was cut off, brought to its end
``unfinished``   what the journal says of one
``status``       what is active, and where it came from
``outcome``      how it ended, and the words for it
``work``         what they all work with
``speaker``      the operator at the terminal
``session``      all of these together, as the command uses them
================ =====================================================================
"""
