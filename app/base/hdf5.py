"""The package h5py, imported at its first use; ``--help`` and solves without a file do not need it."""


def __getattr__(name):
    import h5py

    return getattr(h5py, name)
