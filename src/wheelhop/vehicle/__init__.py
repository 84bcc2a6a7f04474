"""Physics of the vehicle and the road; knows nothing of filters."""
