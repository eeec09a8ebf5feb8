"""A2C, Rainbow and discrete SAC by tianshou's algorithms, each as a `trainer.Trainer`.

Everything here needs the extra `paper`, which has an environment of its own (`make paper`). Import from the modules.
"""
