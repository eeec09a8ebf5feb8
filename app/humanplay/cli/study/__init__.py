"""Commands about studies: plan, freeze, invite, rehearse, report, and where players lose moves."""
