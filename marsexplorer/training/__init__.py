"""Training of the networks: PPO from a freshly initialised network (`ppo`).

`config` has a run's configuration, `envs` its environments, `run_folder` its files. Import from the
modules: they load torch, and the command's help must not.
"""
