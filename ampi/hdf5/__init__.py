"""HDF5 files: how they are written on a disk that may be full, and sealed."""
