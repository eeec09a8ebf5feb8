"""Commands about studies: plan, freeze, invite, rehearse, report, costs."""
