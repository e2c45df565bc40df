"""What goes into a camera and comes out of it: images, packets, files, pictures, statistics."""
