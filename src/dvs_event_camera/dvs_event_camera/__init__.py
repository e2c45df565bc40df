"""Event camera (DVS): luminosity or images in, precisely stamped polarity events out."""
