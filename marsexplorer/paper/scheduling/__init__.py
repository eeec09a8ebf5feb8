"""Jobs on all cores of this machine or on a Ray cluster, with a forecast of the time that is left."""
