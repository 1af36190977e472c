"""Compensation tables safely into a controller: checked, backed up, staged, read back, activated.

==================== =============================================================================
``upload_plan``      what is to be uploaded, read and matched with the configuration
``bounds``           how large tables are, and how far from the present ones
``preflight``        the questions to the controller before anything is written
``lock``             one upload at a time
``steps``            the sequence, and what happens where it breaks
``settle``           finding out what is active after a failure, and putting it right
``shown_correction`` whether the controller adds what the table says
``recovery``         an upload that was cut off, brought to its end
``history``          journal, its head and unfinished uploads; backups; contents and their SHA-256
``status``           what is active, and where it came from
``outcome``          how it ended, and the words for it
``work``             what they all work with
``operator``         the operator at the terminal
``session``          all of these together, as the command uses them
==================== =============================================================================
"""
