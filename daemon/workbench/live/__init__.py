"""The live view of the workbench: a run as it says it stands, its past, its volume at present."""
