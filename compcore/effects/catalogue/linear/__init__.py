"""Linear axes: error motions along the travel, cyclic errors, reversal, local defects."""
