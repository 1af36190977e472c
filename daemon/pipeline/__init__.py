"""The pipeline: poll → convert → compensate → guard → write back, one file a stage.

Every stage's arithmetic is apart from its input and output, and no stage's failure ends
another: a failure is a fault that the guard sees.
"""
