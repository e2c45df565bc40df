"""Wire contract of the suite: model, parameters, codecs, QoS and the base of every node."""
