"""Training of the networks: PPO from a freshly initialised network (`ppo`).

A run's configuration is in `config`, its environments in `envs`, what it writes in `run_folder`. Import from the modules:
they load torch, and the command's help must not.
"""
