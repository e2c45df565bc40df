"""Messages of the loop as CDR bytes, the event index, topic names and quality of service."""
