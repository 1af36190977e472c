"""The pieces of `compcore.campaign_file`: header, metadata, rows, joining, writing."""
