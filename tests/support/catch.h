// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

// The one place that names Catch2's header, and what every test shares of it.
#include <catch2/catch.hpp>
