"""The pieces of `abbe.compcore.files.campaign_file`: header, metadata, rows, joining, writing."""
