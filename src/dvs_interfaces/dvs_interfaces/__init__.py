"""Wire contract of the suite: parameter schema, message codecs, QoS, model types and the managed-node base."""
