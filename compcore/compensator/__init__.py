"""The compensator: a model's error at the machine's pace, live or in batches.

Public: `compensator.Compensator`.
"""
