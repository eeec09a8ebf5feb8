"""Candidates of a move, and what they come to on terrains (see `lookahead`).

Each is walked, and then the priced rule plays.

Kernels take an imagined board and its rover:

    board  of `prices`; its counts are kept for `squares` alone
    truth  uint64[words], the obstacles of the terrain as `blocked` of `visibility` holds them
    done   uint8[rows, cols], 1 where there is nothing to see; cells that prove to be such are
           added: what is seen from a cell only ever shrinks, so they stay so
    rover  int64[3]: its cell, the cells known, the moves made
    rule   (tables of `prices`; highest, limits, weights of `priced.RuleTables`; (scratch of
           `prices`, distance int32[n], queue int32[n]); squares int64[k], half sides; path
           int32[n])
"""

from __future__ import annotations

import numpy as np

from marsexplorer.compiled import inlined, kernel, lowest
from marsexplorer.config import FREE, OBSTACLE, UNKNOWN
from marsexplorer.lidar import ONE
from marsexplorer.policies.kernels.grid import UNREACHABLE, neighbour
from marsexplorer.policies.kernels.posterior import copy_to
from marsexplorer.policies.kernels.prices import SCREEN, count_in_squares, forget_prices, sum_prices
from marsexplorer.policies.kernels.visibility import count_visible, word_and_bit

MOST_CANDIDATES = 16
MOST_MOVES = 4
"""Moves for each cell at which an imagined drive is given up."""
BLOCK = 8
"""Terrains that all candidates are tried on before those that fall behind are dropped."""
APART = 2
"""Rows or columns between two goals, at least."""

POSITION, KNOWN, MOVES = range(3)
"""Places in a rover's array."""


@kernel
def look_round(board, truth, done, rover, squares, cols):
    """Update a board with a look from the rover's cell; return the new cells."""
    known_codes, counts, view = board
    unknown, blocked, sight, visible, stride, radius = view
    row = rover[POSITION] // cols
    col = rover[POSITION] - row * cols
    if done[row, col]:
        return 0
    done[row, col] = 1
    new = count_visible((unknown, truth, sight, visible, stride, radius), row, col)
    if new == 0:
        return 0
    rover[KNOWN] += new
    lane, side = np.int64(sight[0]), 2 * radius + 1
    per_word = 64 // lane
    lane_mask = ~np.uint64(0) >> np.uint64(64 - lane)
    for i in range(side):
        bits = (visible[i // per_word] >> np.uint64((i % per_word) * lane)) & lane_mask
        while bits != np.uint64(0):
            r, c = row + i - radius, col + np.int64(lowest(bits)) - radius
            bits &= bits - ONE
            word, bit = word_and_bit(r, c, stride, radius)
            unknown[word] ^= bit
            blocked[word] |= truth[word] & bit
            known_codes[r * cols + c] = OBSTACLE if truth[word] & bit != np.uint64(0) else FREE
            count_in_squares(counts, squares, r, c, done.shape[0], cols, -1)
    return new


@inlined
def step_to(rover, cell):
    """Move an imagined rover to a neighbouring cell."""
    rover[POSITION] = cell
    rover[MOVES] += 1


@kernel
def trace_back(goal, distance, order, rows, cols, path):
    """Write the cells of a shortest path to a goal but the first; return their count.

    The distance is 0 at the first.

    distance  int32[n], right wherever it is less than the goal's; order: 0 or 2, which of several
              ways back is taken
    """
    cell, length = np.int64(goal), np.int64(distance[goal])
    for k in range(length - 1, -1, -1):
        path[k] = cell
        for turn in range(4):
            near = neighbour(cell, (turn + order) & 3, rows, cols)
            if near >= 0 and distance[near] == k:
                cell = near
                break
    return length


@kernel
def most_priced(board, done, start, rule):
    """The candidate of the highest value from a cell, by the priced rule, or -1.

    `distance` is right up to it.
    """
    tables, highest, limits, weights, search = rule[:5]
    scratch, distance, queue = search
    known_codes, counts, view = board
    rows, cols = done.shape
    limit, last_row = limits[0], (rows - 1) * cols
    forget_prices(scratch)
    distance[:] = UNREACHABLE
    distance[start], queue[0] = 0, start
    head, tail = 0, 1
    best, best_value = np.int64(-1), 0.0
    while head < tail:
        cell = np.int64(queue[head])
        head += 1
        way = distance[cell]
        weight = weights[way, 0]
        if limit * weight < best_value:
            break
        r = cell // cols
        c = cell - r * cols
        if done[r, c] == 0 and counts[SCREEN, cell] > 0:
            new = count_visible(view, r, c)
            if new == 0:
                done[r, c] = 1
            elif highest[new, 0] * weight > best_value:
                sum_prices(r, c, rows, cols, board, tables, scratch)
                value = min(scratch[3][0], limit) * weight
                if value > best_value:
                    best, best_value = cell, value
        for near, is_inside in (
            (cell - cols, cell >= cols),
            (cell + 1, c < cols - 1),
            (cell + cols, cell < last_row),
            (cell - 1, c > 0),
        ):
            is_new = is_inside and distance[near] == UNREACHABLE
            if is_new and known_codes[near] != UNKNOWN and known_codes[near] != OBSTACLE:
                distance[near], queue[tail] = way + 1, near
                tail += 1
    return best


@kernel
def play_on(board, truth, done, rover, rule, target, most):
    """Play by the priced rule to `target` known cells or `most` moves.

    A goal is kept until something new is seen.
    """
    _, distance, _ = rule[4]
    squares, path = rule[5], rule[6]
    rows, cols = done.shape
    while rover[KNOWN] < target and rover[MOVES] < most:
        goal = most_priced(board, done, rover[POSITION], rule)
        if goal < 0:
            rover[MOVES] = most
            return
        length = trace_back(goal, distance, 0, rows, cols, path)
        for k in range(length):
            step_to(rover, np.int64(path[k]))
            if look_round(board, truth, done, rover, squares, cols) > 0:
                break


@kernel
def walk(board, truth, done, rover, way, length, squares, target):
    """Walk a way of known cells, until its end has nothing new to show."""
    cols = done.shape[1]
    end = np.int64(way[length - 1])
    for k in range(length):
        if rover[KNOWN] >= target:
            return
        step_to(rover, np.int64(way[k]))
        new = look_round(board, truth, done, rover, squares, cols)
        if new > 0 and k < length - 1 and count_visible(board[2], end // cols, end % cols) == 0:
            return


@kernel
def list_candidates(board, done, rover, rule, first, last, most, values, goals, ways, lengths):
    """Write the candidates of a move and return how many they are.

    first   the cell that `ppo` goes to; last: the goal that was gone for, or -1
    most    candidates before the last goal is added
    values  float64[n], scratch
    goals   int64[MOST_CANDIDATES], written: candidate 0 is `first`, a goal of -1
    ways    int32[MOST_CANDIDATES, n] and lengths int64[MOST_CANDIDATES], written: the cells of each
            way
    """
    tables, _, limits, weights, search = rule[:5]
    rows, cols = done.shape
    known_codes, counts, view = board
    scratch, distance, queue = search

    # 1. Search from the rover, and value each cell as the priced rule does.
    forget_prices(scratch)
    distance[:] = UNREACHABLE
    distance[rover[POSITION]], queue[0] = 0, rover[POSITION]
    head, tail = 0, 1
    while head < tail:
        cell = np.int64(queue[head])
        head += 1
        r = cell // cols
        c = cell - r * cols
        values[cell] = 0.0
        if done[r, c] == 0 and counts[SCREEN, cell] > 0:
            done[r, c] = count_visible(view, r, c) == 0
        if done[r, c] == 0 and counts[SCREEN, cell] > 0:
            sum_prices(r, c, rows, cols, board, tables, scratch)
            values[cell] = min(scratch[3][0], limits[0]) * weights[distance[cell], 0]
        for action in range(4):
            near = neighbour(cell, action, rows, cols)
            is_new = near >= 0 and distance[near] == UNREACHABLE
            if is_new and known_codes[near] != UNKNOWN and known_codes[near] != OBSTACLE:
                distance[near], queue[tail] = distance[cell] + 1, near
                tail += 1

    # 2. The move of `ppo`, then the goals of the highest values, each by two shortest paths where
    #    they begin differently.
    goals[0], lengths[0], ways[0, 0] = -1, 1, first
    count, has_last = 1, False
    while count < most:
        best, best_value = -1, 0.0
        for k in range(tail):
            if values[queue[k]] > best_value:
                best, best_value = np.int64(queue[k]), values[queue[k]]
        if best < 0:
            break
        has_last |= best == last
        for order in (0, 2):
            lengths[count] = trace_back(best, distance, order, rows, cols, ways[count])
            if order == 0 or (count < most and ways[count, 0] != ways[count - 1, 0]):
                goals[count] = best
                count += 1
        for k in range(tail):
            cell = np.int64(queue[k])
            if abs(cell // cols - best // cols) < APART and abs(cell % cols - best % cols) < APART:
                values[cell] = 0.0

    # 3. The goal that was gone for, while it has something to show.
    is_open = last >= 0 and not has_last and 0 < distance[last] < UNREACHABLE
    if is_open and count_visible(view, last // cols, last % cols) > 0:
        goals[count] = last
        lengths[count] = trace_back(last, distance, 0, rows, cols, ways[count])
        count += 1
    return count


@kernel
def compare(real, trial, truths, samples, drop, rule, target, count, ways, lengths, costs, alive):
    """Try candidates on the same terrains, in blocks; return how many were used.

    Those that fall behind are dropped after each block.

    real, trial  (board, done, rover): what is known, and room for what is imagined
    truths       uint64[S, words], of which `samples` are used
    costs        float64[MOST_CANDIDATES, S], written: moves that each candidate took on each
                 terrain
    alive        uint8[MOST_CANDIDATES], written: candidates that were not dropped
    """
    (known_codes, counts, view), done_before, rover = real
    board, done, walker = trial
    squares = rule[5]
    most = MOST_MOVES * done.size
    alive[:count] = 1
    used = 0
    while used < samples:
        # 1. Each candidate on the next terrains.
        until = min(used + BLOCK, samples)
        for k in range(count):
            if not alive[k]:
                continue
            for s in range(used, until):
                copy_to(board[0], known_codes)
                for square in range(squares.shape[0]):
                    copy_to(board[1][square], counts[square])
                copy_to(board[2][0], view[0])
                copy_to(board[2][1], view[1])
                for row in range(done.shape[0]):
                    copy_to(done[row], done_before[row])
                copy_to(walker, rover)
                walk(board, truths[s], done, walker, ways[k], lengths[k], squares, target)
                play_on(board, truths[s], done, walker, rule, target, most)
                costs[k, s] = walker[MOVES]
        used = until

        # 2. The best so far; whoever is behind it by more than `drop` standard errors of the
        #    difference is dropped.
        best, least = 0, np.inf
        for k in range(count):
            if alive[k]:
                total = 0.0
                for s in range(used):
                    total += costs[k, s]
                if total < least:
                    best, least = k, total
        is_decided = True
        for k in range(count):
            if alive[k] and k != best:
                mean, square_mean = 0.0, 0.0
                for s in range(used):
                    behind = costs[k, s] - costs[best, s]
                    mean += behind
                    square_mean += behind * behind
                mean /= used
                variance = max(square_mean / used - mean * mean, 0.0) / used
                alive[k] = mean <= 0.0 or mean <= drop * np.sqrt(variance)
                is_decided &= not alive[k] or ways[k, 0] == ways[best, 0]

        # 3. Whatever is left begins with the same move: more terrains would change nothing.
        if is_decided:
            break
    return used


@kernel
def fill_truths(chains, rows, cols, stride, radius, truths):
    """Write the usable terrains, one after the other, as bits; return their count."""
    _, covers, usable, _ = chains
    count = 0
    for s in range(covers.shape[0]):
        if usable[s]:
            truths[count, :] = np.uint64(0)
            for r in range(rows):
                for c in range(cols):
                    if covers[s, r * cols + c] > 0:
                        word, bit = word_and_bit(r, c, stride, radius)
                        truths[count, word] |= bit
            count += 1
    return count
