"""Programs around the camera: scene, show_events, packet_bridge."""
