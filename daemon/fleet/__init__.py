"""The plant's store: PostgreSQL that every machine's records are uploaded to, and asked of."""
